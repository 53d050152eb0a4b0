# SPDX-License-Identifier: Apache-2.0
"""Training with a perceptual loss: the weights file, log messages and resuming."""
import json
import math
import random
import struct

from harness import CliTest

USAGE, IO, INVALID = 1, 2, 3
# Name, inputs, outputs and size of the convolutions; channels of the taps.
VGG = ([(f"features.{number}", inputs, outputs, 3) for inputs, outputs, number in (
    (3, 64, 0), (64, 64, 2), (64, 128, 5), (128, 128, 7), (128, 256, 10), (256, 256, 12),
    (256, 256, 14), (256, 512, 17), (512, 512, 19), (512, 512, 21), (512, 512, 24), (512, 512, 26),
    (512, 512, 28))], [64, 128, 256, 512, 512])
SQUEEZE = ([("features.0", 3, 64, 3)] + [
    (f"features.{number}.{part}", inputs if part == "squeeze" else squeezed,
     squeezed if part == "squeeze" else half, 3 if part == "expand3x3" else 1)
    for number, inputs, squeezed, half in (
        (3, 64, 16, 64), (4, 128, 16, 64), (6, 128, 32, 128), (7, 256, 32, 128), (9, 256, 48, 192),
        (10, 384, 48, 192), (11, 384, 64, 256), (12, 512, 64, 256))
    for part in ("squeeze", "expand1x1", "expand3x3")], [64, 128, 256, 384, 384, 512, 512])


def weights(linear, seed=1, network=VGG):
    """Returns a safetensors file of a network with random weights of 16 bits."""
    source = random.Random(seed)
    header, data = {}, []
    size = 0

    def add(name, shape, low, high):
        nonlocal size
        count = math.prod(shape)
        pattern = b"".join(struct.pack("<e", source.uniform(low, high)) for _ in range(997))
        data.append((pattern * (count // 997 + 1))[:2 * count])
        header[name] = {"dtype": "F16", "shape": shape, "data_offsets": [size, size + 2 * count]}
        size += 2 * count

    convolutions, taps = network
    for name, inputs, outputs, side in convolutions:
        scale = math.sqrt(6 / (side * side * inputs))
        add(f"{name}.weight", [outputs, inputs, side, side], -scale, scale)
        add(f"{name}.bias", [outputs], -0.05, 0.05)
    for tap, channels in enumerate(taps if linear else []):
        add(f"lin{tap}.model.1.weight", [1, channels, 1, 1], 0, 1)
    text = json.dumps(header).encode()
    return struct.pack("<Q", len(text)) + text + b"".join(data)


class Perceptual(CliTest):
    def train(self, *more):
        enabled = "--perceptual-weights" in more and "weight_perceptual=0" not in more
        return ["train", self.fixture("prepared"), "-o", "out.stgs", "--preset", "fast",
                "--backend", "cpu", "--max-primitives", "100", "--iterations", "6", "--set",
                "coarse_until=0", *(["--set", "perceptual_patch=16"] if enabled else []),
                "--num-evals", "0", *more]

    def test_the_loss_is_disabled_without_weights(self):
        result = self.succeeds(*self.train("--log", "log.jsonl", "--log-level", "debug"))
        self.assertIn(b"perceptual loss disabled (no --perceptual-weights)",
                      result.stderr)
        self.assertEqual(json.loads(self.read("log.jsonl").splitlines()[-1])["perceptual"], 0)
        self.assertIsNone(self.json_of(*self.train())["perceptual"])
        self.fails(USAGE, "--perceptual-weights has no effect if weight_perceptual is 0",
                   *self.train("--perceptual-weights", "w.safetensors"),
                   "--set", "weight_perceptual=0")

    def test_the_loss_is_enabled_with_weights(self):
        self.succeeds(*self.train())
        scene = self.read("out.stgs")
        for linear, text in ((True, b"enabled: LPIPS (vgg), weights from w.safetensors"),
                             (False, b"uniform channel weights (the file has no LPIPS linear")):
            with self.subTest(linear=linear):
                self.write("w.safetensors", weights(linear))
                args = self.train("--perceptual-weights", "w.safetensors")
                result = self.succeeds(*args, "--log", "log.jsonl", "--report", "page")
                self.assertIn(text, result.stderr)
                self.assertIn(b"slow on the CPU", result.stderr)
                self.assertIn(b"Perceptual loss", self.read("page/index.html"))
                steps = [json.loads(line) for line in self.read("log.jsonl").splitlines()]
                for step in steps:
                    self.check_schema("training_log", step)
                    self.assertGreater(step["perceptual"], 0)
                trained = self.read("out.stgs")
                self.assertNotEqual(trained, scene)
                report = self.json_of(*args, "--threads", "1")
                self.assertEqual(report["perceptual"], {"weights": "w.safetensors",
                                                        "network": "vgg",
                                                        "linear": linear, "weight": 0.01,
                                                        "patch": 16})
                self.assertEqual(self.read("out.stgs"), trained, "threads changed the scene")

    def test_the_network_is_that_of_the_file(self):
        self.write("w.safetensors", weights(True, network=SQUEEZE))
        args = self.train("--perceptual-weights", "w.safetensors")
        self.fails(USAGE, r"perceptual_patch is out of range .* at least 25 pixels, got 16", *args)
        args[args.index("perceptual_patch=16")] = "perceptual_patch=25"
        result = self.succeeds(*args)
        self.assertIn(b"enabled: LPIPS (squeeze), weights from w.safetensors", result.stderr)
        self.assertEqual(self.json_of(*args)["perceptual"]["network"], "squeeze")

    def test_the_loss_starts_at_perceptual_from(self):
        self.write("w.safetensors", weights(False))
        self.succeeds(*self.train("--perceptual-weights", "w.safetensors", "--set",
                                  "perceptual_from=0.5", "--log", "log.jsonl"))
        steps = [json.loads(line) for line in self.read("log.jsonl").splitlines()]
        self.assertEqual([step["iteration"] for step in steps], [1, 6])
        self.assertEqual(steps[0]["perceptual"], 0)
        self.assertGreater(steps[1]["perceptual"], 0)

    def test_a_run_resumes_only_with_the_same_weights(self):
        self.write("w.safetensors", weights(True))
        self.write("other.safetensors", weights(True, seed=2))
        args = self.train("--perceptual-weights", "w.safetensors", "--checkpoint-interval", "4")
        self.succeeds(*args, "--checkpoint", "run.ckpt")
        uninterrupted = self.read("out.stgs")
        # Resuming at the end gives the same scene; other weights are rejected.
        self.succeeds(*args, "--checkpoint", "run.ckpt", "--resume", "run.ckpt")
        self.assertEqual(self.read("out.stgs"), uninterrupted)
        for file in ([], ["--perceptual-weights", "other.safetensors"]):
            result = self.fails(USAGE, "run.ckpt: checkpoint of another run",
                                *self.train(*file, "--resume", "run.ckpt"))
            self.assertRegex(result.stderr, rb" perceptual weights: [0-9a-f]{16}, now ")

    def test_bad_weights_are_rejected(self):
        good = weights(True)
        self.write("cut.safetensors", good[:1000000])
        self.write("text.safetensors", b"these are no weights")
        self.write("incomplete.safetensors", good.replace(b"features.28.bias", b"features.28.tail"))
        self.write("w.safetensors", good)
        cases = [
            (IO, "none.safetensors: cannot open", "none.safetensors", []),
            (INVALID, "cut.safetensors: tensor 'features.* is truncated", "cut.safetensors", []),
            (INVALID, "text.safetensors: not a safetensors file", "text.safetensors", []),
            (INVALID, "incomplete.safetensors: tensor 'features.28.bias' is missing",
             "incomplete.safetensors", []),
            (USAGE, r"perceptual_patch is out of range \(expected 0, the complete image, or at least 16 pixels, got 15",
             "w.safetensors", ["--set", "perceptual_patch=15"]),
        ]
        for code, message, file, more in cases:
            with self.subTest(file=file):
                train = self.train("--perceptual-weights", file)
                if more:
                    patch = train.index("perceptual_patch=16") - 1
                    train[patch:patch + 2] = more
                self.fails(code, message, *train)
