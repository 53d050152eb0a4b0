# SPDX-License-Identifier: Apache-2.0
"""Wrong command lines, --help and --version."""
import os
import re
import shlex
import unittest

import harness
from harness import CliTest, built_in, renders_with

USAGE = 1


class Usage(CliTest):
    def test_wrong_command_lines_are_rejected(self):
        tiny, prepared = self.fixture("tiny.stgs"), self.fixture("prepared")
        render = ["render", tiny, "-o", "out.png"]
        cases = [
            ("unknown verb 'rendr'; did you mean 'render'", ["rendr", tiny]),
            ("unknown verb 'zzzzzz'; the verbs are .*validate", ["zzzzzz"]),
            ("unknown option '--tme'; did you mean '--time'", [*render, "--tme", "0"]),
            ("unknown option '--format-all'", ["info", tiny, "--format-all"]),
            ("--time is given more than once", [*render, "--time", "0", "--time", "1"]),
            ("FILE is required", ["info"]),
            ("FILE is required", ["validate"]),
            ("--output is required", ["render", tiny, "--time", "0"]),
            ("--against is required", ["evaluate", tiny]),
            ("B is required", ["compare", tiny]),
            ("unexpected argument 'extra'", ["evaluate", tiny, "--against", "x", "extra"]),
            ("--format: 'yaml' is not one of", ["info", tiny, "--format", "yaml"]),
            ("--progress: 'often' is not one of", [*render, "--progress", "often"]),
            ("--log-level: 'loud' is not one of", [*render, "--log-level", "loud"]),
            ("--backend: 'abacus' is not one of", [*render, "--backend", "abacus"]),
            ("--video-decoder: 'abacus' is not one of auto, cpu, cuda",
             ["prepare", prepared, "-o", "out", "--video-decoder", "abacus"]),
            ("--threads: -1 is out of range", ["validate", tiny, "--threads", "-1"]),
            ("--threads: 'two' is not a number", ["validate", tiny, "--threads", "two"]),
            ("--seed: '-3' is not an integer",
             ["train", prepared, "-o", "out.stgs", "--seed", "-3"]),
            ("unknown option '--seed'", [*render, "--seed", "3"]),
            ("unknown option '--backend'", ["info", tiny, "--backend", "cpu"]),
            ("--time: 'soon' is not a number", [*render, "--time", "soon"]),
            ("--time: 'nan' is not a number", [*render, "--time", "nan"]),
            ("--time -1 is out of range; .* lasts from 0 to 0.2 s", [*render, "--time", "-1"]),
            ("--time 7 is out of range", [*render, "--time", "7"]),
            ("use --time SECONDS or --frames", render),
            ("--(time|frames) excludes --(time|frames)",
             [*render, "--time", "0", "--frames", "0:1"]),
            ("--frames 0:99 is out of range; the clip has 6 frames", [*render, "--frames", "0:99"]),
            ("--frames 6: is out of range", [*render, "--frames", "6:"]),
            ("--frames: 3:3 is empty", [*render, "--frames", "3:3"]),
            ("--frames: 'all' is not a frame range", [*render, "--frames", "all"]),
            ("'-1:2' is not a frame range", [*render, "--frames=-1:2"]),
            ("--memory: 99K is too small; expected at least 1M", [*render, "--memory", "99K"]),
            ("--memory: '4 G' is not a size in bytes", [*render, "--memory", "4 G"]),
            ("holds one image, not 2", [*render, "--frames", "0:2"]),
            ("--size: '12' is not a size", [*render, "--time", "0", "--size", "12"]),
            ("'0x9' is not a size", [*render, "--time", "0", "--size", "0x9"]),
            ("each 1 to 32768, for example 1280x720", [*render, "--time", "0", "--size", "99999x9"]),
            ("--background: '1,2' is not a colour", [*render, "--time", "0", "--background", "1,2"]),
            ("'1,1,x' is not a colour", [*render, "--time", "0", "--background", "1,1,x"]),
            ("'2,0,0' is not a colour", [*render, "--time", "0", "--background", "2,0,0"]),
            ("--side-by-side requires --cameras", [*render, "--time", "0", "--side-by-side"]),
            ("--which requires --cameras", [*render, "--time", "0", "--which", "all"]),
            ("--cameras? excludes --cameras?",
             [*render, "--time", "0", "--camera", "x.json", "--cameras", prepared]),
            ("unknown output format; use a name that ends in .png", ["render", tiny, "--time", "0", "-o",
                                                            "out.gif"]),
            ("holds one camera, not 2",
             ["render", tiny, "--frames", "0:2", "--cameras", prepared, "--which", "train", "-o",
              "out.y4m"]),
            ("no camera 'z'; the cameras are a, b, c",
             [*render, "--time", "0", "--cameras", prepared, "--which", "z"]),
            ("needs the time of a frame; .* has none at",
             [*render, "--time", "0.01", "--cameras", prepared, "--side-by-side"]),
            ("no start camera; use --camera",
             ["render", self.fixture("no_camera.stgs"), "--time", "0", "-o", "out.png"]),
            ("--every: 0 is out of range", ["evaluate", tiny, "--against", prepared, "--every",
                                            "0"]),
            ("do not match", ["evaluate", self.fixture("longer.stgs"), "--against",
                                        prepared]),
            ("cannot compare an image with a .stgs file", ["compare", tiny, "image.png"]),
            ("--min-psnr: 'high' is not a number", ["compare", tiny, tiny, "--min-psnr", "high"]),
        ]
        for message, args in cases:
            with self.subTest(args=args):
                self.fails(USAGE, message, *args)
        self.assertEqual(os.listdir(self.work), [])

    def test_no_verb_prints_the_help_on_standard_error(self):
        result = self.fails(USAGE, "no verb is given")
        self.assertEqual(result.stdout, b"")
        self.assertIn(b"evaluate", result.stderr)

    @unittest.skipIf(built_in("play"), "play is built in")
    def test_a_build_without_play_reports_it(self):
        self.fails(6, "'play' is not part of this build", "play", self.fixture("tiny.stgs"))

    @unittest.skipIf(not built_in("play"), "play is not built in")
    def test_play_checks_the_location_before_it_needs_a_display(self):
        self.fails(2, "nothere.stgs", "play", "nothere.stgs")
        self.fails(USAGE, "unsupported URL scheme", "play", "ftp://here/a.stgs")

    @unittest.skipIf(renders_with("vulkan"), "Vulkan is built in")
    def test_a_build_without_vulkan_reports_it(self):
        self.fails(6, "'vulkan' is not part of this build; use backend 'cpu'", "render",
                   self.fixture("tiny.stgs"), "--time", "0", "-o", "null", "--backend", "vulkan")

    def test_train_rejects_unsuitable_backends(self):
        for verb in ("train", "encode"):
            args = [verb, self.fixture("prepared"), "-o", "out.stgs", "--backend"]
            with self.subTest(verb=verb):
                self.fails(USAGE, "--backend: 'vulkan' is not one of auto, cpu, cuda", *args, "vulkan")
                if os.path.exists("/dev/nvidiactl"):
                    continue
                result = self.stgs(*args, "cuda")
                self.assertIn(result.returncode, (5, 6))
                self.assertIn(b"use --backend cpu", result.stderr)
        self.assertEqual(os.listdir(self.work), [])

    def test_a_required_video_decoder_that_is_missing_is_reported(self):
        if os.path.exists("/dev/nvidiactl"):
            self.skipTest("there is a GPU")
        for verb, output in (("prepare", "out"), ("encode", "out.stgs")):
            with self.subTest(verb=verb):
                result = self.stgs(verb, self.fixture("prepared"), "-o", output,
                                   "--video-decoder", "cuda")
                self.assertIn(result.returncode, (5, 6))
                self.assertIn(b"use --video-decoder cpu", result.stderr)
        self.assertEqual(os.listdir(self.work), [])


class Help(CliTest):
    def verbs(self):
        text = self.succeeds("--help").stdout.decode()
        return re.findall(r"^  (\w+)  ", text.split("Subcommands:")[1], re.M)

    def test_each_verb_has_an_example_and_exit_codes(self):
        self.assertGreaterEqual(len(self.verbs()), 5)
        for verb in self.verbs():
            with self.subTest(verb=verb):
                text = self.succeeds(verb, "--help").stdout.decode()
                self.assertRegex(text, rf"Example:\n  stgs {verb}\b")
                self.assertIn("Exit codes: 0 ok, 1 usage", text)
                self.assertIn("--format", text)

    def test_shared_options_are_listed_only_where_they_apply(self):
        rendering = {"render", "bench", "evaluate", "compare"}
        training = {"train", "encode"}
        expected = {
            "--progress": rendering | training | {"prepare", "pack"},
            "--log-level": training | {"live", "prepare", "render", "pack", "convert", "finalize", "play", "serve", "web"},
            "--backend": rendering | training | {"live", "prepare"},
            "--threads": rendering | training | {"live", "prepare", "pack", "validate", "convert", "play"},
            "--video-decoder": {"encode", "live", "prepare"},
            "--seed": training | {"live", "prepare", "bench"},
            "--timeout": rendering | {"info", "validate", "play", "web"},
            "--allow-private": rendering | {"info", "validate", "play", "web"},
        }
        for verb in self.verbs():
            text = self.succeeds(verb, "--help").stdout.decode()
            for option, verbs in expected.items():
                self.assertEqual(bool(re.search(rf"{option}\b", text)), verb in verbs,
                                 f"{verb} {option}")

    def test_verbs_list_their_options(self):
        expected = {
            "prepare": "--layout --frames --scale --test-cameras --fps --output",
            "train": "--preset --iterations --max-primitives --max-seconds --resume --checkpoint "
                     "--frame-memory --num-evals --method --ablate --set --log --report --output",
            "pack": "--quality --output",
            "encode": "--layout --frames --window --preset --iterations --quality --keep-work --output",
            "render": "--camera --cameras --which --time --frames --size --background --side-by-side "
                      "--output",
            "evaluate": "--against --cameras --every",
            "info": "--lifespans",
            "play": "--start-camera --size --time --rate --loop --screenshot",
            "serve": "--port --address",
            "web": "--output --single-file --title --bridge --overwrite",
            "compare": "--min-psnr",
            "convert": "--time --quality --fps --frames --tolerance",
        }
        for verb in self.verbs():
            text = self.succeeds(verb, "--help").stdout.decode()
            for option in expected.get(verb, "").split():
                self.assertRegex(text, rf"{option}\b", verb)

    def test_verbs_for_local_files_reject_urls(self):
        for verb in ("pack", "finalize", "convert"):
            output = [] if verb == "convert" else ["-o"]
            self.fails(USAGE, "http://here/a.stgs: this verb reads local files only", verb,
                       "http://me:secret@here/a.stgs", *output, "out.stgs")

    def test_version_lists_the_build(self):
        text = self.succeeds("--version").stdout.decode()
        self.assertRegex(text, r"^stgs \d+\.\d+\.\d+\nformat: \d+\.\d+\nvector target: \w+\n"
                               r"trains with: cpu( cuda)?\nrenders with: (cuda )?cpu( vulkan)?\n"
                               r"built in:")

    def test_readme_commands_use_existing_options(self):
        """Each `stgs VERB ...` line in the README uses existing verbs and options."""
        path = os.path.join(harness.SOURCE, "README.md")
        if not os.path.exists(path):
            self.skipTest("no README.md")
        with open(path, encoding="utf-8") as file:
            text = file.read().replace("\\\n", " ")
        commands = re.findall(r"^\s*(?:\$ )?(?:\./)?(?:build/\w+/bin/)?stgs (.+)$", text, re.M)
        self.assertTrue(commands, "the README shows no command")
        for command in commands:
            words = shlex.split(re.split(r"\s[|>#]", command)[0])
            if words[0].startswith("-"):
                continue
            self.assertIn(words[0], self.verbs(), command)
            help_text = self.succeeds(words[0], "--help").stdout.decode()
            for word in words[1:]:
                if re.match(r"--?[a-z]", word):
                    self.assertRegex(help_text, rf"(?<![\w-]){word.split('=')[0]}\b", command)


if __name__ == "__main__":
    unittest.main()
