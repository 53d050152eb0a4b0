#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Runs the shell commands of a documentation page.

usage: test_commands_in_docs.py PAGE STGS SAMPLE

The ```sh blocks run from top to bottom in one empty folder in which capture/ is the sample capture;
training is shortened. A block right after a line `<!-- not run: WHY -->` is only checked: each `stgs`
command in it must name an existing verb and options that the verb's --help lists. `stgs play` runs
on a virtual display, and is only checked if the build or the machine lacks one. `stgs serve` runs
until it has printed its link; it and `stgs web` are only checked if the build lacks them.
"""
import glob
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile

sys.path.append(os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "play"))
from display import Display  # noqa: E402

BLOCK = re.compile(r"(<!-- not run: .+? -->\n+)?```sh\n(.*?)```", re.DOTALL)
# Enough to check that a command works, not to judge its result.
SHORTENED = {
    "prepare": ["--scale", "0.15"],
    "train": ["--iterations", "20"],
    "play": ["--screenshot", "window.png", "--size", "320x180"],
    "encode": ["--scale", "0.15", "--frames", "0:3", "--iterations", "20"],
    "live": ["--scale", "0.15", "--max-primitives", "1500"],
}


def frames_of(text):
    """Returns the frames to prepare for a page: 3, or as many as its commands train."""
    trained = re.findall(r"stgs train [^\n]*--frames \d+:(\d+)", text)
    return f"0:{max([3, *map(int, trained)])}"


def commands(block):
    """Yields the commands of a block, with continuation lines joined and comments removed."""
    for line in block.replace("\\\n", " ").replace(" && ", "\n").splitlines():
        words = shlex.split(line, comments=True)
        if words:
            yield words


def options_of(stgs, verb, known={}):
    if verb not in known:
        help_run = subprocess.run([stgs, verb, "--help"], capture_output=True, text=True, check=False)
        known[verb] = set(re.findall(r"(?<![\w-])--?[a-z][\w-]*", help_run.stdout)) \
            if help_run.returncode == 0 else None
    return known[verb]


def check_command(stgs, words):
    known = options_of(stgs, words[1])
    if known is None:
        return [f"no verb '{words[1]}'"]
    given = [word.split("=")[0] for word in words[2:] if re.match(r"--?[a-z]", word)]
    return [f"'{words[1]}' has no option {option}" for option in given if option not in known]


def can_run(stgs, verb):
    """Returns whether the build has a verb that is optional, and the machine its requirements."""
    if verb not in ("play", "serve", "web"):
        return True
    version = subprocess.run([stgs, "--version"], capture_output=True, text=True, check=True).stdout
    return f" {verb}" in version and (verb != "play" or shutil.which("Xvfb") is not None)


def run_serve(command, folder):
    with subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as server:
        link = server.stdout.readline()
        server.terminate()
        error = server.stderr.read()
    return [] if link.startswith("http://127.0.0.1:") else [f"no link: {error.strip()}"]


def run_command(command, folder, environment=None):
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True,
                          check=False)


def run_stgs(stgs, words, folder):
    verb = words[1]
    # Expand patterns as the shell does.
    matches = [sorted(glob.glob(word, root_dir=folder)) if "*" in word else [word]
               for word in words[1:]]
    command = [stgs, *(word for found in matches for word in found)]
    shorter = SHORTENED.get(verb, [])
    for option, value in zip(shorter[::2], shorter[1::2]):
        if option not in command:
            command += [option, value]
    if verb == "serve":
        return run_serve(command, folder)
    if verb == "play":
        with Display() as display:
            result = run_command(command, folder, display.environment)
    else:
        result = run_command(command, folder)
    if result.returncode != 0:
        return [f"exit code {result.returncode}: {result.stderr.strip()}"]
    return []


def main():
    page, stgs, sample = (os.path.abspath(path) for path in sys.argv[1:])
    with open(page, encoding="utf-8") as file:
        text = file.read()
    SHORTENED["prepare"] += ["--frames", frames_of(text)]
    problems, ran, checked, expected = [], 0, 0, False
    with tempfile.TemporaryDirectory() as folder:
        os.symlink(sample, os.path.join(folder, "capture"))
        for match in BLOCK.finditer(text):
            expected |= not match.group(1)
            for words in commands(match.group(2)):
                is_stgs = words[0] == "stgs" and len(words) > 1
                found = check_command(stgs, words) if is_stgs else []
                if match.group(1) or (is_stgs and not can_run(stgs, words[1])):
                    checked += 1
                elif not is_stgs:
                    found = ["not an stgs command: mark its block as not run, with the reason"]
                elif not found:
                    ran += 1
                    found = run_stgs(stgs, words, folder)
                problems += [f"{shlex.join(words)}\n    {problem}" for problem in found]
    print("\n".join(problems))
    print(f"{ran} commands run, {checked} checked, {len(problems)} problems")
    sys.exit(1 if problems or (expected and ran == 0) else 0)


if __name__ == "__main__":
    main()
