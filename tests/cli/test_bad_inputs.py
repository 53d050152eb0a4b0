# SPDX-License-Identifier: Apache-2.0
"""Captures, camera files and images that are missing, damaged or out of range."""
import json
import os
import struct
import unittest
import zlib

from harness import CliTest

IO, INVALID, UNSUPPORTED = 2, 3, 5


class BadInputs(CliTest):
    def evaluate(self, folder):
        return ["evaluate", self.fixture("tiny.stgs"), "--against", folder, "--cameras", "all"]

    def test_folders_without_a_prepared_capture_are_rejected(self):
        os.mkdir(self.path("empty"))
        not_prepared = "not a prepared capture .*; make one with 'stgs prepare'"
        for folder, code, message in (
                (self.path("empty"), INVALID, not_prepared),
                (self.path("missing"), IO, "missing: no such file or folder"),
                (self.fixture("tiny.stgs"), INVALID, not_prepared)):
            with self.subTest(folder=folder):
                self.fails(code, message, *self.evaluate(folder))
        self.fails(IO, "missing.json: no such file or folder", "render", self.fixture("tiny.stgs"),
                   "--cameras", self.path("missing.json"), "--time", "0", "-o", "null")

    def test_errors_of_the_memory_limit_name_the_option(self):
        names = "x y z scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3 opacity f_dc_0 f_dc_1 f_dc_2".split()
        count = 20000
        header = f"ply\nformat binary_little_endian 1.0\nelement vertex {count}\n"
        header += "".join(f"property float {name}\n" for name in names) + "end_header\n"
        splats = b"".join(struct.pack("<14f", k % 97, k % 89, k % 83, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0)
                          for k in range(count))
        self.write("many.ply", header.encode() + splats)
        self.succeeds("convert", "many.ply", "many.stgs")
        camera = self.write("camera.json", self.succeeds("info", self.fixture("tiny.stgs"), "--format", "json").stdout)
        self.fails(UNSUPPORTED, "many.stgs: .*memory.*; use a larger --memory", "render", "many.stgs",
                   "--time", "0", "--camera", camera, "-o", "null", "--memory", "1M")

    def test_invalid_capture_json_is_rejected(self):
        with open(os.path.join(self.fixture("prepared"), "capture.json"), encoding="utf-8") as file:
            good = json.load(file)

        def changed(**values):
            return json.dumps({**good, **values})

        camera = good["cameras"][0]
        cases = [
            (INVALID, "capture.json: not valid JSON at line", "{ not json"),
            (INVALID, "capture.json: .*stgs_capture", "{}"),
            (UNSUPPORTED, "unknown version 99", changed(stgs_capture=99)),
            (INVALID, "contains no cameras", changed(cameras=[])),
            (INVALID, '"frames" is 0', changed(frames=0)),
            (INVALID, "time_base is 0/30", changed(time_base=[0, 30])),
            (INVALID, '"width" is -4 .expected an integer from 1 to 32768', changed(cameras=[{**camera, "width": -4}])),
            (INVALID, "\"rotation\" has 2 numbers", changed(cameras=[{**camera, "rotation": [1, 0]}])),
            (INVALID, "cannot be a folder name",
             changed(cameras=[{**camera, "name": "../../etc"}])),
        ]
        for i, (code, message, text) in enumerate(cases):
            with self.subTest(message=message):
                folder = self.copy_capture(f"capture{i}")
                self.write(f"capture{i}/capture.json", text)
                self.fails(code, message, *self.evaluate(folder))

    def test_missing_and_damaged_frames_are_rejected(self):
        folder = self.copy_capture("missing")
        os.remove(self.path("missing/frames/b/000003.png"))
        self.fails(IO, "frames/b/000003.png", *self.evaluate(folder))
        folder = self.copy_capture("size")
        self.succeeds("render", self.fixture("tiny.stgs"), "--time", "0", "--size", "32x24", "-o",
                      self.path("size/frames/a/000002.png"))
        self.fails(INVALID, "camera 'a' frame 2 has the wrong size .expected 64x48, got 32x24",
                   *self.evaluate(folder))
        folder = self.copy_capture("broken")
        self.write("broken/frames/c/000000.png", b"\x89PNG\r\n\x1a\nrubbish")
        self.fails(INVALID, "frames/c/000000.png", *self.evaluate(folder))

    def test_invalid_camera_files_are_rejected(self):
        def render(camera):
            return ["render", self.fixture("tiny.stgs"), "--time", "0", "-o", "null", "--camera",
                    camera]
        good = {"width": 64, "height": 48, "fx": 60, "fy": 60, "cx": 32, "cy": 24,
                "rotation": [1, 0, 0, 0, 1, 0, 0, 0, 1], "translation": [0, 0, 0]}
        self.succeeds(*render(self.write("good.json", json.dumps(good))))
        self.fails(IO, "none.json: cannot open camera file: No such file",
                   *render(self.path("none.json")))
        cases = [
            ("not a camera", "[]"),
            ("not a camera: \"width\" is missing", "{}"),
            ("cannot read camera: not valid JSON at line 1", "{"),
            ("cannot read camera: not valid JSON at line 1", '{"a":"key \'' + 200000 * "x"),
            ("fx and fy must be positive and the centre .cx, cy. finite, in pixels",
             json.dumps({**good, "fx": 0})),
            ("\"height\" is 1000000 .expected an integer from 1 to 32768", json.dumps({**good, "height": 1000000})),
            ("not a rotation matrix", json.dumps({**good, "rotation": [2] * 9})),
            ("not a rotation matrix", json.dumps({**good, "rotation": [1, 0, 0, 0, 1, 0, 0, 0,
                                                                       -1]})),
            ("\"rotation\" has 1 number", json.dumps({**good, "rotation": [1]})),
        ]
        for message, text in cases:
            with self.subTest(message=message):
                self.fails(INVALID, message, *render(self.write("camera.json", text)))

    def test_invalid_images_are_rejected(self):
        bad = self.write("bad.png", b"not an image")
        self.fails(INVALID, "bad.png: cannot decode the image", "compare", bad, bad)
        self.fails(IO, "none.png: cannot open", "compare", self.path("none.png"), bad)

        def png(width, height):
            """Returns the signature and the header of a PNG, which state its size, and no pixels."""
            def chunk(name, body):
                return struct.pack(">I", len(body)) + name + body + struct.pack(
                    ">I", zlib.crc32(name + body))
            header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
            return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", b"")
        wide = self.write("wide.png", png(40000, 10))
        self.fails(INVALID, "wide.png: invalid image size 40000x10", "compare", wide, wide)
        large = self.write("large.png", png(17000, 17000))
        self.fails(UNSUPPORTED, "large.png: image too large: 17000x17000", "compare", large, large)
        os.truncate(wide, (1 << 32) + 100)  # sparse: allocates no blocks
        self.fails(UNSUPPORTED, "wide.png: image file too large: 4294967396 bytes", "compare", wide, wide)


if __name__ == "__main__":
    unittest.main()
