# SPDX-License-Identifier: Apache-2.0
"""The verbs help and version, standard input, titles, and options from a --config file."""
import contextlib
import json
import os
import pty
import re
import subprocess
import tempfile
import unittest

import harness
from harness import CliTest, built_in
from test_manual import help_of, verbs

USAGE, INVALID, UNSUPPORTED = 1, 3, 5


class HelpAndVersion(CliTest):
    def test_help_prints_the_same_as_the_option(self):
        self.assertEqual(self.succeeds("help").stdout.decode(), help_of())
        for verb in verbs():
            self.assertEqual(self.succeeds("help", verb).stdout.decode(), help_of(verb), verb)
        self.assertEqual(self.json_of("help", "render"), {"verb": "render", "text": help_of("render")})
        self.fails(USAGE, "unknown verb 'rendr'; did you mean 'render'", "help", "rendr")

    def test_version_prints_the_same_as_the_option(self):
        text = self.succeeds("--version").stdout.decode()
        self.assertEqual(self.succeeds("version").stdout.decode(), text)
        version = self.json_of("version")
        self.assertEqual(text.split()[1], version["version"])
        self.assertIn("built in: " + (" ".join(version["built_in"]) or "-"), text)
        self.assertIn("cpu", version["renders_with"])


class StandardInput(CliTest):
    def piped(self, name, *args, code=0):
        with open(self.fixture(name), "rb") as file:
            result = self.stgs(*args, stdin=file)
        self.assertEqual(result.returncode, code, result.stderr)
        return result

    def test_scenes_are_read_from_standard_input(self):
        info = json.loads(self.piped("tiny.stgs", "info", "-", "--format", "json").stdout)
        self.assertEqual(info["file"], "standard input")
        self.assertEqual(info["primitives"], 400)
        self.assertEqual(self.piped("tiny.stgs", "validate", "-").stdout, b"standard input: valid\n")
        self.piped("tiny.stgs", "render", "-", "--time", "0.05", "-o", "a.png")
        self.succeeds("render", self.fixture("tiny.stgs"), "--time", "0.05", "-o", "b.png")
        self.assertEqual(self.read("a.png"), self.read("b.png"))
        self.piped("tiny.stgs", "compare", "-", self.fixture("tiny.stgs"), "--min-psnr", "100")
        # evaluate reads the scene twice: to render it and to measure its drift.
        self.piped("tiny.stgs", "evaluate", "-", "--against", self.fixture("prepared"), "--every", "5")

    def test_camera_files_are_read_from_standard_input(self):
        tiny = self.fixture("tiny.stgs")
        camera = self.succeeds("info", tiny, "--format", "json").stdout
        self.write("camera.json", camera)
        with open(self.path("camera.json"), "rb") as file:
            result = self.stgs("render", tiny, "--time", "0", "-o", "a.png", "--camera", "-", stdin=file)
        self.assertEqual(result.returncode, 0, result.stderr)
        self.succeeds("render", tiny, "--time", "0", "-o", "b.png")
        self.assertEqual(self.read("a.png"), self.read("b.png"))

    def test_unsuitable_standard_input_is_rejected(self):
        for verb in (["pack", "-", "-o", "x.stgs"], ["finalize", "-", "-o", "x.stgs"],
                     ["convert", "-", "x.stgs"]):
            self.fails(USAGE, "cannot read standard input", *verb, stdin=subprocess.DEVNULL)
        self.fails(INVALID, "standard input: too short", "info", "-", stdin=subprocess.DEVNULL)
        self.fails(INVALID, "standard input: not an .stgs file; this is a text file", "info", "-",
                   stdin=open(__file__, "rb"))
        master, terminal = pty.openpty()
        self.addCleanup(os.close, master)
        self.addCleanup(os.close, terminal)
        self.fails(USAGE, "standard input is a terminal", "info", "-", stdin=terminal)

    def test_memory_limits_the_bytes_that_are_read(self):
        """No more than --memory and a byte are taken from a stream without end."""
        for verb in (["info", "-"], ["validate", "-"], ["render", "-", "--time", "0", "-o", "a.png"],
                     ["compare", "-", self.fixture("tiny.stgs")], ["bench", "-"],
                     ["evaluate", "-", "--against", self.fixture("prepared")]):
            reader, writer = os.pipe()
            with subprocess.Popen([harness.STGS, *verb, "--memory", "2M"], cwd=self.work, stdin=reader,
                                  stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as process:
                os.close(reader)
                written = 0
                with contextlib.suppress(BrokenPipeError):
                    while True:
                        written += os.write(writer, bytes(4096))
                os.close(writer)
                text = process.stdout.read().decode()
            self.assertEqual(process.returncode, UNSUPPORTED, text)
            self.assertIn("standard input: more than 2097152 bytes; use a larger --memory, or name a file",
                          text, verb)
            self.assertLess(written, (2 << 20) + (1 << 17), verb)  # with what the pipe holds

    def test_a_camera_file_is_short(self):
        with tempfile.TemporaryFile() as file:
            file.truncate((1 << 20) + 1)
            self.fails(UNSUPPORTED, "standard input: more than 1048576 bytes; expected a camera file",
                       "render", self.fixture("tiny.stgs"), "--time", "0", "-o", "a.png", "--camera", "-",
                       stdin=file)

    @unittest.skipIf(not built_in("play"), "play is not built in")
    def test_play_rejects_standard_input(self):
        self.fails(USAGE, "play cannot read standard input", "play", "-", stdin=subprocess.DEVNULL)


class Titles(CliTest):
    def title(self, name):
        return self.json_of("info", name)["title"]

    def test_convert_sets_and_preserves_a_title(self):
        self.succeeds("convert", self.fixture("tiny.stgs"), "a.stgs", "--title", "Dancer, take 2")
        self.assertEqual(self.title("a.stgs"), "Dancer, take 2")
        self.succeeds("convert", "a.stgs", "b.stgs")
        self.assertEqual(self.title("b.stgs"), "Dancer, take 2")
        self.succeeds("pack", "a.stgs", "-o", "c.stgs")
        self.assertEqual(self.title("c.stgs"), "Dancer, take 2")
        self.fails(USAGE, "--title applies to .stgs output, not to PLY", "convert", "a.stgs", "a.ply",
                   "--time", "0", "--title", "x")

    def test_train_sets_a_title(self):
        self.succeeds("train", self.fixture("prepared"), "-o", "t.stgs", "--iterations", "4",
                      "--max-primitives", "50", "--num-evals", "0", "--title", "Dancer",
                      "--backend", "cpu", "--preset", "fast")
        self.assertEqual(self.title("t.stgs"), "Dancer")


class ConfigFiles(CliTest):
    def render(self, *args):
        return json.loads(self.succeeds("render", self.fixture("tiny.stgs"), *args).stdout)

    def test_options_come_from_the_section_of_the_verb(self):
        self.write("a.toml", '# defaults\n[render]\nsize = "32x24"\nformat = "json"\ntime = 0.1\n'
                             'output = "null"\n[train]\niterations = 100\n')
        self.assertEqual(self.render("--config", "a.toml")["cameras"][0]["width"], 32)
        self.assertEqual(self.render("--config=a.toml", "--size", "16x12")["cameras"][0]["width"], 16)
        before = self.stgs("--config", "a.toml", "render", self.fixture("tiny.stgs"))
        self.assertEqual(json.loads(before.stdout)["cameras"][0]["width"], 32)

    def test_lists_and_flags_are_supported(self):
        self.write("b.toml", '[bench]\nanimate = true\ncamera = ["c.json", "c.json"]\n'
                             'num-frames = 2\n')
        self.write("c.json", json.dumps(self.json_of("info", self.fixture("tiny.stgs"))))
        bench = self.json_of("bench", self.fixture("tiny.stgs"), "--config", "b.toml", "--size", "16x12")
        self.assertTrue(bench["animated"])
        self.assertEqual((len(bench["cameras"]), bench["num_frames"]), (2, 2))

    def test_errors_name_the_file_or_the_option(self):
        tiny = self.fixture("tiny.stgs")
        self.write("bad.toml", "[render]\nsise = 3\n")
        self.fails(USAGE, r"--config bad.toml:2: unknown option 'render.sise'; write the options",
                   "render", tiny, "--config", "bad.toml")
        self.fails(USAGE, "--config none.toml: cannot read the file", "info", tiny, "--config",
                   "none.toml")
        render = ["render", tiny, "--time", "0", "-o", "null", "--config", "value.toml"]
        self.write("value.toml", '[render]\nthreads = -1\n')
        self.fails(USAGE, "--config value.toml:2: --threads: -1 is out of range", *render)
        self.write("value.toml", 'render.size = "32x24"\n\n[render]\n  memory= "1"\n')
        self.fails(USAGE, "--config value.toml:4: --memory: 1 is too small; expected at least 1M",
                   *render)
        self.fails(USAGE, "error: --size: 'x' is not a size", "render", tiny, "--size", "x")
        self.fails(USAGE, "--config needs a value", "info", tiny, "--config")

    def test_files_that_are_no_configuration_are_rejected_before_they_are_parsed(self):
        tiny = self.fixture("tiny.stgs")
        for text, message in (("[" + "a." * 20_000 + "a]\n", ":1: a line of 40003 bytes (expected at most 16384)"),
                              ("\n[[" + "a." * 9 + "b]]\n", ":2: a name within more than 8 sections; write [VERB]"),
                              ("#\n" * 40_000, ": more than 65536 bytes (expected options)"),
                              ("." * 40_000, ":1: a line of 40000 bytes"),
                              ("." * 10_000, ":1: a name within more than 8 sections"),
                              ("a" * 10_000 + " = 1", ":1: unknown option")):
            self.write("x.toml", text)
            self.fails(USAGE, re.escape("--config x.toml" + message), "info", tiny, "--config", "x.toml")

    def test_a_configuration_that_is_not_a_regular_file_is_refused_without_a_wait(self):
        os.mkfifo(self.path("pipe.toml"))
        for name in ("pipe.toml", "/dev/zero"):
            self.fails(USAGE, f"--config: '{name}' is not a regular file", "info", self.fixture("tiny.stgs"),
                       "--config", name)


class Completion(CliTest):
    PROGRAM = """
source "$1"
shift
COMP_WORDS=("$@") COMP_CWORD=$(($# - 1))
_stgs
printf '%s\\n' "${COMPREPLY[@]}"
"""

    def complete(self, line):
        words = line.replace("=", " = ").split(" ")
        script = os.path.join(harness.SOURCE, "tools", "completion", "stgs.bash")
        run = subprocess.run(["bash", "--norc", "-c", self.PROGRAM, "bash", script, harness.STGS,
                              *words[1:]], capture_output=True, text=True, check=True, cwd=self.work)
        self.assertEqual(run.stderr, "")
        return set(run.stdout.split())

    def test_bash_completes_layouts_parameters_and_verbs(self):
        self.assertEqual(self.complete("stgs prepare x --layout n"), {"n3dv", "nerfstudio"})
        parameters = self.json_of("train", "--list-parameters")["parameters"]
        for line in ("stgs train x --set ", "stgs encode x --set "):
            self.assertEqual(self.complete(line), {key + "=" for key in parameters})
        self.assertEqual(self.complete("stgs train x --set weight_s"),
                         {"weight_scale=", "weight_ssim="})
        self.assertEqual(self.complete("stgs train x --set=weight_s"),
                         {"weight_scale=", "weight_ssim="})
        self.assertEqual(self.complete("stgs train x --set weight_ssim=0"), set())
        self.assertEqual(self.complete("stgs help ren"), {"render"})


if __name__ == "__main__":
    unittest.main()
