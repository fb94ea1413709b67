"""How reports look: on screens of any width, by day and by night, and in print."""

STYLE = """
:root { color-scheme: light dark; --ink: #33302b; --quiet: #716b61; --line: #d9d5cc; --ground: #f3f1ec;
  --paper: #ffffff; --accent: #0064a0; --good: #00704f; --warn: #a34a00; --bad: #b00020; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e9e5dc; --quiet: #a8a297; --line: #45413a; --ground: #2b2925; --paper: #1c1a17; --accent: #7cc4f2;
    --good: #5fd0a8; --warn: #f2a65a; --bad: #ff8a92; } }
* { box-sizing: border-box; }
html { -webkit-text-size-adjust: 100%; }
body { margin: 0 auto; padding: clamp(1rem, 4vw, 2.5rem) clamp(1rem, 4vw, 2.5rem) 2rem; max-width: 68rem;
  background: var(--paper); color: var(--ink); font: 1rem/1.55 system-ui, -apple-system, "Segoe UI", "Helvetica Neue",
  Arial, sans-serif; }
h1 { margin: 0 0 .4rem; font-size: clamp(1.5rem, 4.5vw, 2.1rem); line-height: 1.2; font-weight: 650;
  letter-spacing: -.015em; overflow-wrap: anywhere; }
h2 { margin: 2.6rem 0 .8rem; padding-top: .9rem; border-top: 1px solid var(--line); font-size: 1.3rem; line-height: 1.3;
  font-weight: 620; letter-spacing: -.01em; }
h3 { margin: 1.6rem 0 .5rem; font-size: 1.02rem; }
p { max-width: 44rem; margin: .6rem 0; }
p.lead { font-size: 1.1rem; }
p.note { border-left: 3px solid var(--warn); padding-left: .8rem; }
a { color: var(--accent); }
nav ul { display: flex; flex-wrap: wrap; gap: .2rem 1.3rem; list-style: none; margin: 1rem 0 0; padding: 0;
  font-size: .93rem; }
.tiles { display: grid; grid-template-columns: repeat(auto-fit, minmax(9.5rem, 1fr)); gap: .8rem; margin: 1.3rem 0 0; }
.tiles div { background: var(--ground); border-radius: 6px; padding: .7rem .9rem; }
.tiles dt { color: var(--quiet); font-size: .85rem; }
.tiles dd { margin: 0; font-size: 1.3rem; line-height: 1.35; font-weight: 600; font-variant-numeric: tabular-nums; }
.scroll { overflow-x: auto; margin: 1rem 0; }
table { border-collapse: collapse; font-size: .93rem; font-variant-numeric: tabular-nums; }
caption { text-align: left; font-weight: 600; padding: .3rem 0; }
th, td { text-align: left; vertical-align: top; padding: .34rem 1.4rem .34rem 0; border-bottom: 1px solid var(--line); }
thead th { color: var(--quiet); font-weight: 500; vertical-align: bottom; }
tbody th { font-weight: 500; }
.facts tbody th { color: var(--quiet); white-space: nowrap; }
.good { color: var(--good); } .warn { color: var(--warn); } .bad { color: var(--bad); font-weight: 600; }
.pictures { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(100%, 22rem), 1fr)); gap: 1rem 2rem;
  align-items: start; }
figure { margin: 1rem 0; min-width: 0; }
figure svg, figure img { display: block; width: 100%; height: auto; }
figure img { background: #fff; border-radius: 4px; }
figure svg * { stroke-linejoin: round; stroke-linecap: butt; }
figure svg text { font-family: inherit !important; }
figure svg image { image-rendering: pixelated; }
.whole { white-space: nowrap; }
.narrow { max-width: 30rem; }
.medium { max-width: 48rem; }
figcaption { color: var(--quiet); font-size: .88rem; margin-top: .35rem; max-width: 44rem; }
.player iframe { display: block; width: 100%; height: min(820px, 96vh); border: 1px solid var(--line);
  border-radius: 6px; background: #fff; color-scheme: light; }
table code { white-space: nowrap; }
code, pre { font: .88rem/1.5 ui-monospace, SFMono-Regular, Menlo, Consolas, monospace; }
pre { margin: .2rem 0; padding: .6rem .8rem; background: var(--ground); border-radius: 5px; overflow-x: auto; }
.commands dt { margin-top: .8rem; } .commands dd { margin: 0; }
details { margin: .8rem 0; } summary { cursor: pointer; color: var(--accent); }
a:focus-visible, summary:focus-visible, .scroll:focus-visible { outline: 2px solid var(--accent); outline-offset: 2px; }
footer { margin-top: 3rem; border-top: 1px solid var(--line); color: var(--quiet); font-size: .88rem; }
.print-only { display: none; }
@media (max-width: 36rem) { .scroll table:not(.facts) { width: max-content; } .facts caption { display: block; }
  .facts, .facts tbody, .facts tr, .facts th, .facts td { display: block; border: 0;
  padding-right: 0; } .facts th { padding-bottom: 0; } .facts td { padding-top: 0;
  border-bottom: 1px solid var(--line); } }
@media print {
  :root { color-scheme: light; --ink: #000; --quiet: #444; --line: #bbb; --ground: #f3f1ec; --paper: #fff;
    --accent: #000; --good: #000; --warn: #000; --bad: #000; }
  body { padding: 0; max-width: none; font-size: 10pt; } nav, .player, .screen-only { display: none; }
  .print-only { display: block; } h2 { break-after: avoid; } figure, tr, .tiles div { break-inside: avoid; }
  .tiles div, pre { border: 1px solid var(--line); }
  pre { white-space: pre-wrap; overflow-wrap: anywhere; } .scroll { overflow: visible; } }
"""
