#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Encodes a long synthetic capture in windows, kills the encoder at random times, and resumes it.

usage: long_capture.py --build FOLDER [options] [-- OPTION...]

Options after -- are passed to `stgs encode`. Prints the figures of the run as JSON: durations of windows and memory
at the start and at the end, size, and PSNR of a test camera. Exits with 1 if the file is not valid or incomplete, or
the encoder ended before all kills. Durations are those between two windows of one process. Start and end are the
medians of the first and of the last fifth.
"""
import argparse
import csv
import json
import pathlib
import random
import re
import statistics
import subprocess
import sys
import tempfile
import threading
import time

SAMPLE_SECONDS = 0.2  # between two samples of the memory
WINDOW = re.compile(r"stgs: frames (\d+):(\d+): \d+ primitives? added")


def resources(pid):
    """Returns the resident memory in bytes and the number of open files of a process; None after its end."""
    try:
        status = pathlib.Path(f"/proc/{pid}/status").read_text(encoding="ascii")
        files = len(list(pathlib.Path(f"/proc/{pid}/fd").iterdir()))
    except OSError:
        return None
    found = re.search(r"VmRSS:\s+(\d+) kB", status)
    return (1024 * int(found.group(1)), files) if found else None


class Encoder:
    """A process of `stgs encode`. Records the time and the resources at the end of each window."""

    def __init__(self, command, resumes_at):
        self.begin, self.resumes_at = time.monotonic(), resumes_at  # frame
        self.windows, self.last_lines, self.peak = [], [], 0
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.reader = threading.Thread(target=self._read_log)
        self.reader.start()

    def _read_log(self):
        for line in self.process.stderr:
            self.last_lines = self.last_lines[-9:] + [line.rstrip()]
            found = WINDOW.match(line)
            usage = resources(self.process.pid)
            if found and usage:
                self.windows.append({"end_frame": int(found.group(2)), "time": time.monotonic(),
                                     "resident_bytes": usage[0], "open_files": usage[1]})

    def sample(self):
        """Waits until the next sample and takes it. Returns whether the process runs."""
        time.sleep(SAMPLE_SECONDS)
        usage = resources(self.process.pid)
        self.peak = max(self.peak, usage[0] if usage else 0)
        return self.process.poll() is None

    def end(self, kill):
        """Kills the process or waits for its end. Returns its output."""
        if kill:
            self.process.kill()
        output = self.process.stdout.read()
        self.process.wait()
        self.reader.join()
        self.process.stdout.close()
        self.process.stderr.close()
        return output


class Kills:
    """When to kill: a random part of a window's duration after a random frame is encoded, or after the start of a
    process that resumes behind it."""

    def __init__(self, count, frames, seed):
        numbers = random.Random(seed)
        frames = sorted(numbers.randint(*frames) for _ in range(count))
        self.plan = [(frame, numbers.random()) for frame in frames]

    def due(self, encoder, window_seconds):
        if not self.plan:
            return False
        frame, part = self.plan[0]
        reached = [window["time"] for window in encoder.windows if window["end_frame"] >= frame]
        if encoder.resumes_at >= frame:
            reached = [encoder.begin]
        return bool(reached) and time.monotonic() - reached[0] >= part * window_seconds


class LongRun:
    def __init__(self, options, work):
        self.options, self.work = options, work
        self.stgs, self.generator = (str(options.build / "bin" / name) for name in ("stgs", "make_room_capture"))
        self.rig = ["--cameras", str(options.cameras), "--size", options.size, "--fps", str(options.fps)]
        self.output = str(work / "long.stgs")
        self.encoded = 0
        self.runs = []

    def json_of(self, *arguments):
        command = [self.stgs, *map(str, arguments), "--format", "json"]
        return json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL).stdout)

    def encode(self):
        """Runs the encoder until it has finished the file."""
        options = self.options
        command = [self.stgs, "encode", str(self.work / "capture"), "-o", self.output, "--window", str(options.window),
                   "--log-level", "info", "--progress", "none", "--format", "json", *options.encode]
        last = max(options.kill_from, options.frames - 2 * options.window)
        kills, finished = Kills(options.kills, (options.kill_from, last), options.seed), False
        while not finished:
            encoder = Encoder(command, self.encoded)
            self.runs.append(encoder)
            killed = False
            while encoder.sample():
                if encoder.windows:
                    self.encoded = max(self.encoded, encoder.windows[-1]["end_frame"])
                killed = kills.due(encoder, self.window_seconds())
                if killed:
                    kills.plan.pop(0)
                    break
            output = encoder.end(killed)
            finished = encoder.process.returncode == 0
            if not finished and not killed:
                sys.exit("long_capture.py: the encoder failed:\n" + "\n".join(encoder.last_lines))
            note = "finished" if finished else f"killed after frame {self.encoded}"
            seconds = time.monotonic() - encoder.begin
            print(f"run {len(self.runs)}: {note}, {seconds:.0f} s", file=sys.stderr, flush=True)
        return json.loads(output)

    def durations(self):
        """Seconds of the windows that follow another of the same process."""
        return [b["time"] - a["time"] for run in self.runs for a, b in zip(run.windows, run.windows[1:])]

    def window_seconds(self):
        """Returns the duration of recent windows."""
        return statistics.median(self.durations()[-5:] or [10])

    def psnr(self):
        """Returns (frame, dB) of the test camera near the start, in the middle and near the end."""
        last, images = self.options.frames - 1, self.work / "images"
        frames = sorted({round(last * part) for part in (0.02, 0.25, 0.5, 0.75, 0.98)})
        subprocess.run([self.generator, images, *self.rig, "--images", ",".join(map(str, frames))], check=True)
        out = []
        for frame in frames:
            rendered = images / f"rendered-{frame:06}.png"
            self.json_of("render", self.output, "--camera", images / "test00.json", "--time", frame / self.options.fps,
                         "-o", rendered)
            difference = self.json_of("compare", rendered, images / f"test00-{frame:06}.png")
            out.append((frame, round(difference["psnr"], 2)))
        return out

    def figures(self, report):
        windows = [window for run in self.runs for window in run.windows]
        durations = self.durations()
        # More memory than the default: without the limit on work, which is for files of strangers.
        valid = subprocess.run([self.stgs, "validate", self.output, "--memory", "8G"], check=False,
                               stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL).returncode == 0
        frames = self.json_of("info", self.output)["frames"]
        minutes = self.options.frames / self.options.fps / 60
        resumes = [run.windows[0]["time"] - run.begin for run in self.runs[1:] if run.windows]

        def ends(values):
            count = max(1, len(values) // 5)
            return {"start": statistics.median(values[:count]), "end": statistics.median(values[-count:])}

        return {"valid": valid, "frames": frames, "kills": len(self.runs) - 1, "windows": len(windows),
                "seconds_per_window": ends(durations) if durations else None,
                "windows_per_minute": ends([60 / value for value in durations]) if durations else None,
                "seconds_to_first_window_after_resume": ends(resumes) if resumes else None,
                "resident_bytes": ends([window["resident_bytes"] for window in windows]),
                "open_files": ends([window["open_files"] for window in windows]),
                "peak_memory_bytes": max(run.peak for run in self.runs),
                "file_bytes": report["bytes"], "file_bytes_per_minute": round(report["bytes"] / minutes),
                "psnr_db": self.psnr()}

    def write_windows(self, path):
        with open(path, "w", newline="", encoding="utf-8") as file:
            table = csv.writer(file)
            table.writerow(["run", "end_frame", "seconds_since_start", "resident_bytes", "open_files"])
            for number, run in enumerate(self.runs):
                for window in run.windows:
                    table.writerow([number, window["end_frame"], round(window["time"] - self.runs[0].begin, 2),
                                    window["resident_bytes"], window["open_files"]])

    def run(self):
        capture, description = self.work / "capture", self.work / "capture.txt"
        arguments = [*self.rig, "--frames", str(self.options.frames)]
        if not capture.exists():
            generated = self.work / "capture.part"
            subprocess.run([self.generator, generated, *arguments], check=True)
            description.write_text(" ".join(arguments), encoding="ascii")
            generated.rename(capture)
        if description.read_text(encoding="ascii") != " ".join(arguments):
            sys.exit(f"long_capture.py: {capture}: was made with other options; name another --work folder")
        figures = self.figures(self.encode())
        if self.options.windows:
            self.write_windows(self.options.windows)
        print(json.dumps(figures, indent=2))
        complete = figures["frames"] == self.options.frames and figures["kills"] == self.options.kills
        return figures["valid"] and complete


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0], usage=__doc__.split("\n")[2][7:])
    parser.add_argument("--build", type=pathlib.Path, required=True, help="folder with bin/")
    parser.add_argument("--frames", type=int, default=300)
    parser.add_argument("--fps", type=float, default=10)
    parser.add_argument("--cameras", type=int, default=8, help="one test camera is added")
    parser.add_argument("--size", default="160x90")
    parser.add_argument("--window", type=int, default=30, help="frames")
    parser.add_argument("--kills", type=int, default=3)
    parser.add_argument("--kill-from", type=int, default=0, help="first frame after which to kill, to continue a run")
    parser.add_argument("--seed", type=int, default=1, help="of the times of the kills")
    parser.add_argument("--work", type=pathlib.Path,
                        help="keep the capture and the file in this folder; the next run with it continues")
    parser.add_argument("--windows", type=pathlib.Path, help="write a row for each window to this CSV file")
    parser.add_argument("encode", nargs="*", help="options of stgs encode")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="long_capture-") as temporary:
        sys.exit(0 if LongRun(options, options.work or pathlib.Path(temporary)).run() else 1)


if __name__ == "__main__":
    main()
