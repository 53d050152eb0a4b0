# SPDX-License-Identifier: Apache-2.0
"""`stgs convert` from and to the formats of other programs."""
import json
import os
import struct

from harness import CliTest


def vertices(ply):
    """Returns the vertex properties of a binary PLY by name, and the number of vertices."""
    header, body = ply.split(b"end_header\n", 1)
    names = [line.split()[-1].decode() for line in header.splitlines()
             if line.startswith(b"property float")]
    count = len(body) // (4 * len(names))
    rows = struct.iter_unpack(f"<{len(names)}f", body)
    return dict(zip(names, zip(*rows))), count


class Converting(CliTest):
    def test_one_time_converts_to_ply(self):
        tiny = self.fixture("tiny.stgs")
        result = self.json_of("convert", tiny, "a.ply", "--time", "0.1")
        self.assertEqual(result["input_format"], "STGS")
        self.assertEqual(result["output_format"], "PLY")
        self.assertEqual(result["primitives_in"], 400)
        self.assertLess(result["primitives"], 400)
        self.assertEqual(result["time_s"], 0.1)
        self.assertEqual(result["frames"], 1)
        self.assertTrue(all(value == 0 for name, value in result["errors"].items()
                            if name != "rotation_max"))
        self.assertEqual(result["bytes_out"], os.path.getsize(self.path("a.ply")))
        values, count = vertices(self.read("a.ply"))
        self.assertEqual(count, result["primitives"])
        self.assertEqual(len(values), 17 + 9)
        self.assertGreater(min(values["opacity"]), -5.6)  # logit of 1/255: -5.54

    def test_a_converted_time_renders_like_the_scene(self):
        tiny = self.fixture("tiny.stgs")
        start = self.json_of("info", tiny)["start_camera"]
        self.write("start.json", json.dumps(start))
        self.succeeds("render", tiny, "--time", "0.1", "--camera", "start.json", "-o", "expected.png")
        min_psnr = {"ply": 60, "spz": 38, "stgs": 60}
        for suffix, psnr in min_psnr.items():
            converted = f"converted.{suffix}"
            self.succeeds("convert", tiny, converted, "--time", "0.1")
            self.succeeds("convert", converted, f"{suffix}.stgs")
            self.succeeds("render", f"{suffix}.stgs", "--time", "0", "--camera", "start.json",
                          "-o", "actual.png")
            self.succeeds("compare", "expected.png", "actual.png", "--min-psnr", str(psnr))

    def test_properties_that_the_target_cannot_hold_are_reported(self):
        result = self.succeeds("convert", self.fixture("tiny.stgs"), "a.spz", "--time", "0.1")
        error = result.stderr.decode()
        for part in ("stgs: warning: ", "without motion and lifespans", "not visible at that time",
                     "SPZ cannot hold the start camera, the title",
                     "SPZ rounds or clips: positions by up to "):
            self.assertIn(part, error)
        self.assertRegex(result.stdout.decode(), r"errors: position \S+ max")
        quiet = self.succeeds("convert", "a.spz", "b.ply")
        self.assertEqual(quiet.stderr, b"")

    def test_round_trips_preserve_every_primitive(self):
        self.succeeds("convert", self.fixture("tiny.stgs"), "a.ply", "--time", "0")
        first = self.json_of("convert", "a.ply", "b.stgs")
        self.assertEqual(first["notes"], [])
        self.assertIsNone(first["time_s"])
        self.succeeds("validate", "b.stgs")
        self.succeeds("convert", "b.stgs", "c.ply")
        before, after = (sorted(zip(*vertices(self.read(name))[0].values()))
                         for name in ("a.ply", "c.ply"))
        self.assertEqual(before, after)
        packed = self.json_of("convert", "a.ply", "d.stgs", "--quality", "85.5")
        self.assertEqual(self.json_of("info", "d.stgs")["profile"], "quantised")
        self.assertGreater(packed["errors"]["position_max"], 0)
        self.assertLess(packed["errors"]["position_max"], 0.03)
        unpacked = self.json_of("convert", "d.stgs", "e.stgs")
        self.assertEqual(unpacked["notes"], ["the input was packed before: its quantisation errors remain"])

    def test_a_scene_converts_to_a_complete_scene(self):
        result = self.json_of("convert", self.fixture("tiny.stgs"), "copy.stgs")
        self.assertEqual(result["frames"], 6)
        self.assertEqual(result["notes"], [])
        self.succeeds("compare", self.fixture("tiny.stgs"), "copy.stgs", "--min-psnr", "100")

    def test_one_time_converts_to_glb(self):
        result = self.json_of("convert", self.fixture("tiny.stgs"), "a.glb", "--time", "0.1")
        self.assertIsNone(result["errors"])
        data = self.read("a.glb")
        self.assertEqual(struct.unpack("<4sII", data[:12]), (b"glTF", 2, len(data)))
        text = json.loads(data[20:20 + struct.unpack("<I", data[12:16])[0]])
        self.assertEqual(text["extensionsUsed"], ["KHR_gaussian_splatting"])
        self.assertEqual(text["accessors"][0]["count"], result["primitives"])
        self.fails(5, "cannot read glTF, only write it", "convert", "a.glb", "b.ply")

    def test_convert_rejects_unsuitable_arguments(self):
        tiny = self.fixture("tiny.stgs")
        self.fails(1, r"lasts 0\.2 s, but PLY holds a single time; select one with --time", "convert",
                   tiny, "a.ply")
        self.fails(1, r"--time 0\.3 is out of range; .*tiny.stgs lasts from 0 to 0\.2 s", "convert", tiny, "a.ply",
                   "--time", "0.3")
        self.fails(1, r"a\.jpg: unknown output format; .* \.stgs, \.ply, \.spz, \.glb",
                   "convert", tiny, "a.jpg", "--time", "0")
        self.fails(1, "--quality applies to .stgs", "convert", tiny, "a.ply", "--time", "0",
                   "--quality", "50")
        self.fails(2, "missing.ply: cannot open", "convert", "missing.ply", "a.stgs")
        self.fails(3, "x.ply", "convert", self.write("x.ply", b"not a splat"), "a.stgs")
        self.fails(3, "truncated", "convert", self.write("x.ply", b"ply\nformat ascii 1.0\n"),
                   "a.stgs")
        self.succeeds("convert", tiny, "a.ply", "--time", "0")
        self.fails(1, "a.ply: used by both IN and OUT", "convert", "a.ply", "./a.ply")
        self.assertEqual(sorted(os.listdir(self.work)), ["a.ply", "x.ply"])

    def test_outputs_do_not_depend_on_threads(self):
        for threads in ("1", "2"):
            for suffix in ("ply", "spz", "glb", "4dgs"):
                self.succeeds("convert", self.fixture("tiny.stgs"), f"{threads}.{suffix}", "--time",
                              "0.1", "--threads", threads)
        for suffix in ("ply", "spz", "glb", "4dgs"):
            self.assertEqual(self.read(f"1.{suffix}"), self.read(f"2.{suffix}"))
