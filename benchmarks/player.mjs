// How fast the player's page follows a dragged slider, in headless Chromium without a graphics card; and screenshots.
//
//   npm install playwright-core
//   node benchmarks/player.mjs gait.html shots [path of chromium]
//
// Prints pictures per second while the slider and the cursor of the chart are dragged over all frames and while the
// motion plays, what a picture costs all processes of the browser, and the time until the first one.
import fs from "node:fs";
import path from "node:path";
import { pathToFileURL } from "node:url";
import { chromium } from "playwright-core";

const [, , page, shots = ".", executablePath = "/usr/bin/chromium"] = process.argv;
const MARK = "--use-angle=swiftshader"; // by which the browser's processes are known
const MOVES = 150; // of the mouse, from one end to the other

const browser = await chromium.launch({
  executablePath,
  args: ["--no-sandbox", "--use-gl=angle", MARK, "--enable-unsafe-swiftshader", "--disable-background-networking"],
});
const tab = await browser.newPage({ viewport: { width: 1280, height: 860 } });
tab.on("pageerror", (error) => console.log("error:", error.message));
tab.on("request", (request) => {
  if (/^(http|ws)/.test(request.url())) console.log("asks the network:", request.url());
});

const begun = performance.now();
await tab.goto(pathToFileURL(path.resolve(page)).href);
await tab.waitForFunction(() => window.player?.renders > 0, null, { timeout: 120_000 });
console.log(`first picture after ${((performance.now() - begun) / 1000).toFixed(1)} s,`,
  `${(fs.statSync(page).size / 1e6).toFixed(1)} MB,`, await tab.evaluate(() => player.stages[0].about.frames), "frames");

// Seconds that all processes of the browser have worked.
function worked() {
  let ticks = 0;
  for (const process of fs.readdirSync("/proc").filter((name) => /^\d+$/.test(name))) {
    try {
      if (!fs.readFileSync(`/proc/${process}/cmdline`, "utf8").includes(MARK)) continue;
      const fields = fs.readFileSync(`/proc/${process}/stat`, "utf8").split(") ").at(-1).split(" ");
      ticks += Number(fields[11]) + Number(fields[12]);
    } catch { /* it has ended */ }
  }
  return ticks / 100;
}

async function measured(what, act) {
  const state = () => tab.evaluate(() => [player.renders, performance.now()]);
  const [before, work] = [await state(), worked()];
  await act();
  const after = await state(), pictures = after[0] - before[0], seconds = (after[1] - before[1]) / 1000;
  console.log(`${what}: ${(pictures / seconds).toFixed(1)} pictures a second,`,
    `${((worked() - work) * 1000 / pictures).toFixed(0)} ms of work each`);
}

for (const [what, selector, left, right] of [["slider", "#slider", 8, 8], ["chart", ".chart", 112, 92]]) {
  const box = await tab.locator(selector).first().boundingBox(), y = box.y + box.height / 2;
  const span = box.width - left - right;
  await tab.mouse.move(box.x + left, y);
  await tab.mouse.down();
  await measured(what, async () => {
    for (let i = 0; i <= MOVES; i++) await tab.mouse.move(box.x + left + span * i / MOVES, y);
  });
  await tab.mouse.up();
}
await tab.evaluate(() => { player.seek(0); player.play(true); });
await measured("playing", () => tab.waitForTimeout(4000));
await tab.evaluate(() => player.play(false));

fs.mkdirSync(shots, { recursive: true });
for (const part of [0, 0.3, 0.6, 1]) {
  await tab.evaluate((p) => player.seek(p * player.duration), part);
  await tab.waitForTimeout(1000);
  await tab.screenshot({ path: path.join(shots, `${path.basename(page, ".html")}-${Math.round(100 * part)}.png`) });
}
await browser.close();
