"""Tables are sent to a controller in order and in time, and lines are vented whatever happens."""

import errno
import json
import os
import pty
import shutil
import signal
import subprocess
import sys
import termios
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from worker_checks import heed_interrupts

from robots.hardware import PneumaticRig, export_csv, read_csv, write_csv
from robots.hardware.channel_table import PressureScale, Rhythm, Wave, channel_table
from robots.hardware.controller import check_baud, serial_link
from robots.hardware.stream import CommaLines, JsonLines, Sample, stream_of
from robots.inflatable import ROLLING

ROOT = Path(__file__).parents[3]
QUICK = """name = "quick"
shortest_state_s = 0.02
[channels.core]
rise_s = 0.2
fall_s = 0.2
slew_kpa_per_s = 1e4
[channels.bladder]
rise_s = 0.05
fall_s = 0.05
slew_kpa_per_s = 1e4
[channels.foot]
rise_s = 0.05
fall_s = 0.05
slew_kpa_per_s = 1e4
"""
REFUSES_NOTHING = replace(
    PneumaticRig(), channels=tuple(replace(channel, slew_kpa_per_s=1e9) for channel in PneumaticRig().channels)
)


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "quick.toml").write_text(QUICK)
    export_csv(ROLLING, tmp_path / "quick.csv", PneumaticRig.load(tmp_path / "quick.toml"))
    export_csv(ROLLING, tmp_path / "gait.csv")
    export_csv(ROLLING, tmp_path / "psi.csv", units="psi")
    return tmp_path


class Controller(threading.Thread):
    """The other end of a serial line: keeps lines with the time they came, and answers what it is told to."""

    def __init__(self, answer=None):
        super().__init__(daemon=True)
        self.end, own = pty.openpty()
        self.path, self.lines, self.answer = os.ttyname(own), [], answer
        self._own = own
        self.start()

    def run(self):
        rest = b""
        while True:
            try:
                rest += os.read(self.end, 65536)
            except OSError:
                return
            *whole, rest = rest.split(b"\n")
            for line in whole:
                self.lines.append((time.monotonic(), line.decode()))
                if self.answer and (reply := self.answer(line.decode())):
                    os.write(self.end, reply.encode() + b"\n")

    def wait_for(self, what, seconds=30.0):
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            if any(what in line for _, line in list(self.lines)):
                return
            time.sleep(0.01)
        raise AssertionError(f"no {what!r} in {self.lines[-3:]}")

    def documents(self):
        return [json.loads(line) for _, line in self.lines]


def ok(line):
    document = json.loads(line)
    return f"ok {document['n']}" if "n" in document else None


@pytest.mark.parametrize("rate", [1.0, 3.3, 40.0])
def test_a_dry_run_has_the_pressures_that_are_sent(folder, rate):
    stream = stream_of(read_csv(folder / "quick.csv"), PneumaticRig.load(folder / "quick.toml"), loops=4, rate=rate)
    sent = np.array([sample.pressures for sample in stream])
    told = np.array([each[1:3] for each in stream.extremes()])
    np.testing.assert_allclose(told, np.column_stack([sent.min(axis=0), sent.max(axis=0)]), rtol=0, atol=1e-9)


def test_samples_too_few_for_the_rows_are_told_with_a_rate_that_is_enough(folder):
    table, rig = read_csv(folder / "quick.csv"), PneumaticRig.load(folder / "quick.toml")
    coarse = stream_of(table, rig, rate=12.0, loops=1)
    samples = list(coarse)
    sent = np.array([sample.pressures for sample in samples])
    moments = np.array([sample.time_s for sample in samples])
    off = [
        np.abs(np.interp(table.times, moments, sent[:, line]) - table.pressures[:, line]).max()
        / np.ptp(table.pressures[:, line])
        for line in range(11)
    ]  # the rows of a table whose main is played once
    miss, name = coarse.largest_miss()
    assert miss == pytest.approx(max(off), abs=1e-9) and miss > 0.1 and name == table.channels[int(np.argmax(off))]
    [note] = coarse.notes()
    assert f"{100 * miss:.2g} % of the swing of {name}; --rate 20 keeps within 1 %" in note
    assert stream_of(table, rig, loops=1).notes() == []  # at 20 Hz each corner of this table is a sample
    assert (
        "no --rate up to 1000"
        in stream_of(replace(table, times=table.times / 1e4), REFUSES_NOTHING, rate=12.0).notes()[0]
    )


def test_what_misleads_is_noted_before_anything_is_sent(morpholab, folder):
    code, out, error = morpholab("play gait.csv --to - --no-wait --rate 3")
    assert code == 0 and out.startswith('{"stream"')
    assert error.startswith("morpholab play: note: 3 samples a second are too few")
    code, _, error = morpholab("play psi.csv --dry-run")
    assert code == 0 and "the table is in psi, the rig dissertation in kPa" in error
    document = json.loads(morpholab("play psi.csv --dry-run --json --rate 3")[1])
    assert len(document["notes"]) == 2
    assert morpholab("play gait.csv --dry-run")[2] == ""


@pytest.mark.long
def test_lines_arrive_in_order_and_in_time(morpholab, folder):
    controller = Controller(ok)
    options = f"--port {controller.path} --ready 0 --rig quick.toml --ack 10 --late 60"
    code, out, error = morpholab(f"play quick.csv {options} --loops 2 --json")
    assert (code, error) == (0, "")
    controller.wait_for("stop")
    head, *samples, last = [line for line in controller.documents() if "heartbeat" not in line]
    told = json.loads(out)
    assert head["stream"] == "morpholab-stream-1" and head["units"] == "kpa" and last == {"stop": "end"}
    assert [sample["n"] for sample in samples] == list(range(head["samples"])) and told["samples"] == len(samples)
    arrived = [at for at, line in controller.lines if line.startswith('{"n"')]
    # No sample is early; how late they are depends on the machine.
    assert min(at - arrived[0] - sample["t"] for at, sample in zip(arrived, samples, strict=True)) > -0.1
    assert samples[-1]["section"] == "suffix" and not any(samples[-1]["p"])


def test_samples_lie_on_the_rows(folder):
    table = read_csv(folder / "gait.csv")
    stream = stream_of(table, loops=3, rate=10.0)
    samples = list(stream)
    lengths = table.durations
    assert [sample.section for sample in samples] == sorted(
        (sample.section for sample in samples), key=("prefix", "main", "suffix").index
    )
    assert samples[-1].time_s == pytest.approx(lengths["prefix"] + 3 * lengths["main"] + lengths["suffix"])
    pressures = np.array([sample.pressures for sample in samples])
    rise = PneumaticRig().channels
    for line, channel in enumerate(rise):
        assert np.abs(np.diff(pressures[:, line])).max() <= channel.slew_kpa_per_s / 10 * 1.001
    period = round(lengths["main"] * 10)
    first = round(lengths["prefix"] * 10)
    np.testing.assert_allclose(pressures[first + period], pressures[first + 2 * period], atol=1e-9)
    assert len(list(stream_of(table, loops=0))) < len(samples)


@pytest.mark.long
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGHUP, 129)])
def test_an_interruption_vents(folder, number, code):
    """Ctrl-C, and a terminal that is closed."""
    controller = Controller()
    command = [sys.executable, "-m", "optim.cli", "play", "quick.csv", "--port", controller.path, "--ready", "0"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    process = subprocess.Popen(
        [*command, "--rig", "quick.toml", "--loops", "100000", "--late", "60"],
        cwd=folder,
        env=environment,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=heed_interrupts,
    )
    controller.wait_for('"main"')
    process.send_signal(number)
    if number == signal.SIGHUP:  # shells and the kernel both send one
        controller.wait_for('"vent"')
        process.send_signal(number)
    _, error = process.communicate(timeout=60)
    assert process.returncode == code and error.count("\n") == 1
    controller.wait_for("stop")
    whole = [json.loads(line) for _, line in controller.lines if line.endswith("}")]
    samples = [line for line in whole if "n" in line]
    assert whole[-1] == {"stop": "interrupted"}
    assert samples[-1]["section"] == "vent" and not any(samples[-1]["p"])
    assert [sample["n"] for sample in samples] == list(range(len(samples)))


@pytest.mark.parametrize(
    ("answer", "told"),
    [(None, "no answer 'ok 0' within 0.1 s"), (lambda line: "stop", "the controller asked to stop at sample 0")],
)
def test_a_controller_that_fails_is_vented(morpholab, folder, answer, told):
    controller = Controller(answer)
    code, _, error = morpholab(f"play quick.csv --port {controller.path} --ready 0 --rig quick.toml --ack 0.1")
    assert code == 1 and told in error and error.count("\n") == 1
    controller.wait_for('{"stop":"failed"}')


def test_a_dry_run_tells_and_sends_nothing(morpholab, folder):
    code, out, _ = morpholab("play psi.csv --dry-run --loops 5")
    assert code == 0 and "nothing is sent" in out and "main played 5 times" in out
    assert "core: 0 to 7.252 psi; dissertation allows -11.6 to 7.252" in out
    document = json.loads(morpholab("play psi.csv --dry-run --json")[1])
    assert document["units"] == "psi" and len(document["pressures"]) == 11


def test_files_need_no_waiting(morpholab, folder):
    assert morpholab("play gait.csv --to out.csv --format csv --no-wait --rate 5")[0] == 0
    lines = (folder / "out.csv").read_text().splitlines()
    assert lines[0].startswith("H,morpholab-stream-1,kpa,5.0,") and lines[-1] == "STOP,end"
    assert {len(line.split(",")) for line in lines[1:-1]} == {4 + 11}


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ("gait.csv --to gait.csv", "to: gait.csv is the table, which is only read; name another file"),
        ("gait.csv --to link.csv", "to: link.csv is the table, which is only read; name another file"),
        ("gait.csv --to second.csv", "to: second.csv is the table, which is only read; name another file"),
        (
            "gait.csv --rig quick.toml --to quick.toml",
            "to: quick.toml is the rig, which is only read; name another file",
        ),
        ("gait.csv --to psi.csv", "to: psi.csv exists; name a new file"),
        ("gait.csv --to .", "to: . is a folder; name a file"),
    ],
)
def test_no_stream_takes_the_place_of_what_is_there(morpholab, folder, options, told):
    """Neither of its own table, by whatever name, nor of any other file."""
    (folder / "link.csv").symlink_to("gait.csv")
    os.link(folder / "gait.csv", folder / "second.csv")
    before = {path: path.read_bytes() for path in folder.iterdir()}
    assert morpholab(f"play {options} --no-wait") == (2, "", f"morpholab play: error: {told}\n")
    assert {path: path.read_bytes() for path in folder.iterdir()} == before


def test_pipes_and_empty_files_take_a_stream(morpholab, folder):
    (folder / "empty").touch()
    (folder / "link").symlink_to("target")
    os.mkfifo(folder / "pipe")
    reader = os.open(folder / "pipe", os.O_RDONLY | os.O_NONBLOCK)
    try:
        for name in ("empty", "link", "pipe"):
            assert morpholab(f"play gait.csv --to {name} --format csv --no-wait --rate 5")[0] == 0
        assert (folder / "pipe").is_fifo() and os.read(reader, 1_000_000).endswith(b"STOP,end\n")
    finally:
        os.close(reader)
    assert (folder / "empty").read_bytes() == (folder / "target").read_bytes() != b""


def test_a_reader_that_lags_behind_makes_the_stream_late_and_hears_at_once(morpholab, folder):
    """A pipe of the usual size would hold a minute of lines that nobody has read, and vent after that."""
    os.mkfifo(folder / "pipe")
    heard = list[bytes]()

    def read_slowly():
        with open(folder / "pipe", "rb", buffering=0) as pipe:
            while some := pipe.read(60):  # about a line
                heard.append(some)
                time.sleep(0.01 if b"STOP" in b"".join(heard) else 0.2)

    reader = threading.Thread(target=read_slowly)
    reader.start()
    code, _, told = morpholab("play gait.csv --to pipe --format csv --rate 20 --late 0.3")
    begun = time.monotonic()
    reader.join()
    assert code == 1 and "late, more than --late 0.3" in told
    assert b"".join(heard).count(b"STOP") == 1 and time.monotonic() - begun < 5


def test_a_file_in_which_sending_failed_is_not_in_the_way(morpholab, folder, monkeypatch):
    line = "play gait.csv --to lines.jsonl --no-wait"
    with monkeypatch.context() as broken:

        def full(*_):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        broken.setattr("robots.hardware.controller.os.write", full)
        told = "morpholab play: failed: lines.jsonl: cannot be written (No space left on device)\n"
        assert morpholab(line) == (1, "", told)
    assert not (folder / "lines.jsonl").exists()
    assert morpholab(line)[0] == 0 and (folder / "lines.jsonl").exists()


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ("gait.csv", "port: is missing"),
        ("gait.csv --to a --port b", "to: it is not allowed beside --port"),
        ("gait.csv --port /dev/none", "port: /dev/none cannot be opened"),
        ("gait.csv --port gait.csv", "port: gait.csv is no serial device"),
        ("gait.csv --port /dev/none --baud 1234", "baud: 1234 is not allowed"),
        ("gait.csv --port /dev/none --no-wait", "no-wait"),
        ("gait.csv --to a --ack 1", "ack: nothing answers"),
        ("quick.csv --dry-run", "rig: the table is for 'quick'"),
        ("gait.csv --dry-run --rig weak.toml", "bladder"),
        ("psi.csv --dry-run --rig weak.toml", "psi"),
        ("quick.csv --dry-run --rig dissertation", "kPa/s"),
        ("gait.csv --port /dev/none --baud 9600", "need"),
        ("gait.csv --port /dev/none --ack 1e300", "--ack: 1e+300 is not allowed; give a number from 0 to 3600 s"),
        ("gait.csv --port /dev/none --ready 3600.1", "--ready: 3600.1 is not allowed; give a number from 0 to 3600 s"),
        ("gait.csv --port /dev/none --late 1e10", "a number from 0 to 3600 s"),
    ],
)
def test_what_is_refused(morpholab, folder, options, told):
    (folder / "weak.toml").write_text("[channels.bladder]\nmaximum_kpa = 15.0\n")
    code, _, error = morpholab(f"play {options}")
    assert code == 2 and told in error and error.count("\n") == 1


def test_a_file_for_which_the_disk_has_no_room_is_work_that_failed(morpholab, folder, monkeypatch):
    opened = os.open

    def full(path, *given):
        if path == "lines.jsonl":
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), path)
        return opened(path, *given)

    monkeypatch.setattr(os, "open", full)
    told = "morpholab play: failed: to: lines.jsonl cannot be opened (No space left on device)\n"
    assert morpholab("play gait.csv --to lines.jsonl --no-wait") == (1, "", told)


def test_a_slow_stream_vents_quickly(folder):
    """As fast as lines and their limits of rate allow, not at its own next samples."""
    table = read_csv(folder / "gait.csv")
    stream = stream_of(table, rate=0.1)
    last = next(sample for sample in stream if sample.pressures[0] > 40)
    venting = list(stream.venting(last))
    fall = PneumaticRig().channels[0].fall_s
    assert venting[0].time_s - last.time_s == pytest.approx(0.2)
    assert venting[-1].time_s - last.time_s == pytest.approx(fall, abs=0.2) and not any(venting[-1].pressures)
    quick = stream_of(table, rate=50.0)
    assert next(quick.venting(last)).time_s - last.time_s == pytest.approx(0.02)


@pytest.mark.parametrize("rate", [0.3, 7.0, 50.0, 500.0, 1000.0])
def test_a_limit_of_rate_holds_at_every_rate_of_samples(folder, rate):
    """Steps of a table of many samples are small, and as fast; what is written for a rig is not too fast for it."""
    (folder / "slow.toml").write_text(
        "[channels.core]\nslew_kpa_per_s = 5.0\n[channels.bladder]\nslew_kpa_per_s = 5.0\n"
    )
    slow = PneumaticRig.load(folder / "slow.toml")
    export_csv(ROLLING, folder / "fast.csv", rate=rate)
    fast = read_csv(folder / "fast.csv")
    stream_of(fast)
    if rate > 1:
        with pytest.raises(ValueError, match=r"^core: 10\.6\d* kPa/s at .* the rig's limit is 5 kPa/s"):
            stream_of(fast, slow)
        core, *others = PneumaticRig().channels
        near = [PneumaticRig("near", channels=(replace(core, slew_kpa_per_s=most), *others)) for most in (10.6, 10.7)]
        with pytest.raises(ValueError, match=r"^core: 10\.6"):  # 50 kPa in 4.7 s are 10.638 kPa/s
            stream_of(fast, near[0])
        stream_of(fast, near[1])
    export_csv(ROLLING, folder / "slow.csv", slow, rate=rate, on_violation="clip")
    stream_of(read_csv(folder / "slow.csv"), slow)


def test_numbers_between_commas_have_four_decimals():
    sample = Sample(3, 0.15, "main", (123.45678, -101.325, -0.00001, 12.0, 1234.56789))
    assert CommaLines().sample(sample) == "S,3,0.150000,main,123.4568,-101.325,0,12,1234.5679"


def test_a_port_is_set_up_whatever_used_it_and_taken_by_one_player(morpholab, folder):
    """One stop bit, no flow control; two players would mix their lines."""
    end, own = pty.openpty()
    path, settings = os.ttyname(own), termios.tcgetattr(own)
    settings[2] |= termios.CSTOPB | termios.CRTSCTS | termios.PARODD
    termios.tcsetattr(own, termios.TCSANOW, settings)
    with serial_link(path, 115200):
        assert not termios.tcgetattr(own)[2] & (termios.CSTOPB | termios.CRTSCTS | termios.PARODD | termios.PARENB)
        code, _, error = morpholab(f"play gait.csv --port {path} --ready 0")
        assert code == 2 and f"port: {path} is in use by another player" in error and error.count("\n") == 1
    assert termios.tcgetattr(own)[2] & termios.CSTOPB
    os.close(end)


def test_a_slow_line_is_refused(folder):
    with pytest.raises(ValueError, match=r"rate: 100 Hz is not allowed, as lines of \d+ characters need"):
        check_baud(stream_of(read_csv(folder / "gait.csv"), rate=100.0), JsonLines(), 9600)


def test_the_python_reader_follows_and_vents(morpholab, folder):
    reader = ROOT / "examples/rig/reader.py"
    assert morpholab("play quick.csv --rig quick.toml --to s.jsonl --no-wait")[0] == 0
    lines = (folder / "s.jsonl").read_text().splitlines()

    def read(text, check=True):
        return subprocess.run([sys.executable, reader], input=text, capture_output=True, text=True, check=check).stdout

    said = read("\n".join(lines) + "\n").splitlines()
    assert said[-1] == "vent: end" and len(said) == len(lines) - 1 and said[5].startswith("kpa ")
    assert read("\n".join([*lines[:3], *lines[4:]]) + "\n").splitlines()[-1] == "vent: sample 2 is missing"
    assert read("\n".join(lines[:3]) + "\n" + lines[3][:9] + "?\n").splitlines()[-1] == "vent: closed"
    noisy = "\n".join([*lines[:2], "7", "null", '"stop"', *lines[2:]]) + "\n"
    assert read(noisy).splitlines() == said  # noise that is JSON
    assert read("\n".join([*lines[:2], '{"n": 1}']) + "\n", check=False).splitlines()[-1] == "vent: the reader failed"
    fewer = json.dumps({**json.loads(lines[2]), "p": [1.0]})
    assert read("\n".join([*lines[:2], fewer]) + "\n").splitlines()[-1] == "vent: sample 1 has other lines"
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        streams = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
        environment = os.environ | {"PYTHONUNBUFFERED": "1"}
        streams["preexec_fn"] = heed_interrupts
        process = subprocess.Popen([sys.executable, reader], **streams, text=True, env=environment)
        process.stdin.write("\n".join(lines[:3]) + "\n")
        process.stdin.flush()
        assert process.stdout.readline().startswith("kpa ")
        process.send_signal(number)
        assert process.stdout.read().splitlines()[-1] == "vent: interrupted"  # before its input is closed
        process.communicate()


ARDUINO = """
#include <cstdio>
#include <cstdlib>
#include <cstring>
static long now = 0;
static unsigned long millis() { return now; }
struct Line {
  void begin(long) {}
  int next = EOF;
  int available() { if (next == EOF) next = getchar(); return next != EOF; }
  char read() { char c = (char)next; next = EOF; return c; }
  void print(const char *text) { printf("%s", text); }
  void println(const char *text) { printf("%s\\n", text); }
  void println(long number) { printf("%ld\\n", number); }
} Serial;
"""


def test_a_rig_of_own_lines_is_played_to_a_controller(morpholab, folder):
    (folder / "two.toml").write_text('lines = ["left", "right"]\n[channels.default]\nslew_kpa_per_s = 1e4\n')
    rig = PneumaticRig.load(folder / "two.toml")
    wave = Wave("a", np.array([0.0, 1.0]), PressureScale(0.0, 1.0, 0.0, 20.0), {})
    write_csv(channel_table("robot", [wave], Rhythm(20.0, 1, 0.05, 2), rig), folder / "two.csv")
    controller = Controller(ok)
    line = f"play two.csv --port {controller.path} --ready 0 --ack 2 --rate 40 --rig two.toml"
    assert morpholab(line)[0] == 0
    controller.wait_for('{"stop":"end"}')
    header, *samples = controller.documents()
    assert header["channels"] == ["left", "right"]
    assert {len(each["p"]) for each in samples if "n" in each} == {2}
    code, out, error = morpholab("play two.csv --dry-run --rig two.toml")
    assert code == 0 and "\nright: 0 to 0 kPa; two allows 0 to 20" in out
    told = {
        "": "the table is for 'two', whose limits are not known",
        " --rig quick.toml": "quick has 11 lines, the table",
    }
    for options, why in told.items():
        code, out, error = morpholab(f"play two.csv --dry-run{options}")
        assert code == 2 and error.startswith(f"morpholab play: error: rig: {why}") and error.count("\n") == 1
    assert morpholab("play gait.csv --dry-run --rig two.toml")[2].endswith("rig: two has 2 lines, the table has 11\n")


@pytest.mark.skipif(shutil.which("g++") is None, reason="needs g++")
def test_the_arduino_reader_answers_every_sample(morpholab, folder):
    sketch = (ROOT / "examples/rig/reader/reader.ino").read_text()
    (folder / "a.cpp").write_text(f"{ARDUINO}{sketch}\nint main() {{ setup(); loop(); }}\n")
    subprocess.run(["g++", "-Wall", "-Werror", "-o", folder / "a", folder / "a.cpp"], check=True)
    assert morpholab("play quick.csv --rig quick.toml --to s.csv --format csv --no-wait")[0] == 0
    lines = (folder / "s.csv").read_text().splitlines(keepends=True)

    def read(text):
        return subprocess.run(
            [folder / "a"], input=text, capture_output=True, text=True, check=True
        ).stdout.splitlines()

    assert read("".join(lines)) == [f"ok {n}" for n in range(len(lines) - 2)]
    assert read("".join([*lines[:3], *lines[4:]])) == ["ok 0", "ok 1", "stop"]
