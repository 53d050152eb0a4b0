# SPDX-License-Identifier: Apache-2.0
"""LPIPS in compare and evaluate, with a network of random weights."""
import json
import math
import random
import struct

from harness import CliTest

USAGE, IO, INVALID, UNSUPPORTED = 1, 2, 3, 5
FIRES = [(3, 64, 16, 64), (4, 128, 16, 64), (6, 128, 32, 128), (7, 256, 32, 128), (9, 256, 48, 192), (10, 384, 48, 192),
         (11, 384, 64, 256), (12, 512, 64, 256)]
TAPS = [64, 128, 256, 384, 384, 512, 512]


def squeeze_net():
    """Returns a safetensors file of a random SqueezeNet 1.1 with 16 bits per weight."""
    source = random.Random(1)
    header, data, size = {}, [], 0
    tensors = [("features.0.weight", [64, 3, 3, 3]), ("features.0.bias", [64])]
    for number, inputs, squeezed, expanded in FIRES:
        for part, shape in (("squeeze", [squeezed, inputs, 1, 1]), ("expand1x1", [expanded, squeezed, 1, 1]),
                            ("expand3x3", [expanded, squeezed, 3, 3])):
            tensors += [(f"features.{number}.{part}.weight", shape), (f"features.{number}.{part}.bias", shape[:1])]
    tensors += [(f"lin{tap}.model.1.weight", [1, channels, 1, 1]) for tap, channels in enumerate(TAPS)]
    for name, shape in tensors:
        count = math.prod(shape)
        low, high = (0, 1) if name.startswith("lin") else (-0.2, 0.2)
        pattern = b"".join(struct.pack("<e", source.uniform(low, high)) for _ in range(997))
        data.append((pattern * (count // 997 + 1))[:2 * count])
        header[name] = {"dtype": "F16", "shape": shape, "data_offsets": [size, size + 2 * count]}
        size += 2 * count
    text = json.dumps(header).encode()
    return struct.pack("<Q", len(text)) + text + b"".join(data)


class Lpips(CliTest):
    def setUp(self):
        super().setUp()
        self.write("squeeze.safetensors", squeeze_net())

    def test_images_are_compared(self):
        scene = self.fixture("tiny.stgs")
        for name, time in (("a.png", "0"), ("b.png", "0.1")):
            self.succeeds("render", scene, "--time", time, "-o", name, "--size", "96x64")
        same = self.json_of("compare", "a.png", "a.png", "--lpips", "squeeze.safetensors")
        self.assertEqual((same["lpips"], same["lpips_network"]), (0, "squeeze"))
        other = self.json_of("compare", "a.png", "b.png", "--lpips", "squeeze.safetensors")
        self.assertGreater(other["lpips"], 0)
        self.assertNotIn("lpips", self.json_of("compare", "a.png", "b.png"))
        text = self.succeeds("compare", "a.png", "b.png", "--lpips", "squeeze.safetensors").stdout
        self.assertIn(f"lpips (squeeze) {other['lpips']:.5f}".encode(), text)

    def test_errors(self):
        scene = self.fixture("tiny.stgs")
        self.succeeds("render", scene, "--time", "0", "-o", "a.png", "--size", "96x64")
        self.succeeds("render", scene, "--time", "0", "-o", "small.png", "--size", "16x11")
        compare = ("compare", "a.png", "a.png", "--lpips")
        self.fails(IO, "missing.safetensors", *compare, "missing.safetensors")
        self.fails(INVALID, "a.png", *compare, "a.png")
        self.fails(UNSUPPORTED, "LPIPS of 96x64 pixels needs", *compare, "squeeze.safetensors", "--memory", "1M")
        self.fails(UNSUPPORTED, r"LPIPS \(squeeze\) needs images of at least", "compare", "small.png", "small.png",
                   "--lpips", "squeeze.safetensors")

    def test_a_scene_is_evaluated(self):
        command = ("evaluate", self.fixture("tiny.stgs"), "--against", self.fixture("prepared"), "--every", "7")
        report = self.json_of(*command, "--lpips", "squeeze.safetensors")
        self.assertEqual(report["lpips_network"], "squeeze")
        mean = sum(view["lpips"] * view["frames"] for view in report["views"]) / report["images"]
        self.assertAlmostEqual(report["lpips"], mean, 9)
        self.assertGreater(report["lpips"], 0)
        self.assertNotIn("lpips", self.json_of(*command))
