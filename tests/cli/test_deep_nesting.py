# SPDX-License-Identifier: Apache-2.0
"""JSON, YAML, XML and TOML that nest deeply are rejected before a parser or a message recurses."""
import json
import os
import shutil
import unittest
import zipfile

import harness
from harness import CliTest, built_in

INVALID, UNSUPPORTED = 3, 5
DEPTH = 200000
DEEP = "[" * DEPTH + "]" * DEPTH
DEEP_OBJECT = '{"a":' * DEPTH + "1" + "}" * DEPTH
TOO_DEEP = "more than 64 nested"


class DeepModels(CliTest):
    def archive(self, name, meta):
        with zipfile.ZipFile(self.path(name), "w") as file:
            file.writestr("meta.json", meta)
        return name

    def convert(self, code, message, name):
        self.fails(code, message, "convert", name, "out.stgs")
        self.assertFalse(os.path.exists(self.path("out.stgs")))

    @unittest.skipUnless(built_in("sog"), "needs a build with SOG")
    def test_models(self):
        for name, meta in (("a.tsog", '{"version":%s}'), ("a.sog", '{"version":2,"means":%s}'),
                           ("a.sogst", '{"format":%s,"version":1}')):
            for value in DEEP, DEEP_OBJECT:
                with self.subTest(name=name, value=value[:2]):
                    self.convert(INVALID, f"{name}.*: {TOO_DEEP}", self.archive(name, meta % value))

    @unittest.skipUnless(built_in("sog"), "needs a build with SOG")
    def test_messages_do_not_quote_lists(self):
        wide = json.dumps([1] * 100000)
        for name, meta, message in (
                ("a.tsog", '{"version":%s,"timeline":{}}', r"expected 4, got an array\)$"),
                ("a.sogst", '{"format":%s,"version":1}', 'format is an array, expected "sogst"'),
                ("b.tsog", '{"version":"%s","timeline":{}}' % ("x" * 5000), r"got \"x{59}\.\.\.\)$")):
            with self.subTest(name=name):
                text = meta % wide if "%s" in meta else meta
                self.convert(INVALID if name == "a.sogst" else UNSUPPORTED, message,
                             self.archive(name, text))

    def test_cameras_of_splatv(self):
        text = ('[{"type":"splat","size":0,"cameras":%s}]' % DEEP).encode()
        self.write("a.splatv", (0x674B).to_bytes(4, "little") + len(text).to_bytes(4, "little") + text)
        self.convert(INVALID, f"a.splatv: .*{TOO_DEEP}", "a.splatv")

    def test_camera_files(self):
        self.write("camera.json", DEEP)
        self.fails(INVALID, f"camera.json: .*{TOO_DEEP}", "render", self.fixture("tiny.stgs"),
                   "--time", "0", "--camera", "camera.json", "-o", "null")

    def test_prepared_captures(self):
        folder = self.copy_capture("prepared")
        self.write("prepared/capture.json", DEEP)
        self.fails(INVALID, f"capture.json: {TOO_DEEP}", "evaluate", self.fixture("tiny.stgs"),
                   "--against", folder, "--cameras", "all")


@unittest.skipUnless(built_in("prepare"), "needs a build with OpenCV")
class DeepCaptures(CliTest):
    YAML = {
        "brackets": "%YAML:1.0\n---\nnames: " + DEEP + "\n",
        "maps": "%YAML:1.0\n---\nnames: " + "{a: " * DEPTH + "1" + "}" * DEPTH + "\n",
        "lines": "%YAML:1.0\n---\nnames:\n" + " [\n" * DEPTH,
        "hidden": "%YAML:1.0\n---\nnames: " + "\n {a]: " * DEPTH + "\n",
        "texts": '%YAML:1.0\n---\nnames:\n' + ' [ "]",\n' * DEPTH,
        "comments": "%YAML:1.0\n---\nnames:\n" + " [ # ]\n" * DEPTH,
        "dashes": "%YAML:1.0\n---\nnames:\n " + "- " * DEPTH + "1\n",
        "keys": "%YAML:1.0\n---\nnames:\n " + "a: " * DEPTH + "1\n",
        "json": '{"names":' + DEEP + "}",
        "json comments": '{"names": /* " */' + "[ /* ] */ " * DEPTH,
        "xml": '<?xml version="1.0"?><opencv_storage>' + "<a>" * DEPTH,
        "xml comments": '<?xml version="1.0"?><opencv_storage>' + "<a><!-- </a> -->" * DEPTH,
    }

    def prepare(self, message):
        self.fails(INVALID, message, "prepare", "capture", "-o", "out")
        self.assertEqual(os.listdir(self.work), ["capture"])

    def test_easyvolcap(self):
        os.makedirs(self.path("capture", "images", "00"))
        self.write("capture/extri.yml", "%YAML:1.0\n---\nnames:\n  - \"00\"\n")
        for name, text in self.YAML.items():
            with self.subTest(name=name):
                self.write("capture/intri.yml", text)
                self.prepare("intri.yml: .*(nested|indented|not valid XML)")

    def test_json_layouts(self):
        os.makedirs(self.path("capture"))
        for name, text in (("cameras.json", '{"a":{"K":%s}}'), ("transforms.json", '{"frames":%s}')):
            with self.subTest(name=name):
                self.write(f"capture/{name}", text % DEEP)
                self.prepare(f"{name}: {TOO_DEEP}")
                os.remove(self.path("capture", name))

    def test_messages_do_not_quote_objects(self):
        os.makedirs(self.path("capture"))
        wide = json.dumps({str(i): 0 for i in range(100000)})
        self.write("capture/transforms.json", json.dumps({"frames": [{
            "file_path": "a.png", "w": 8, "h": 8, "fl_x": 8, "transform_matrix": [[{"a": [1] * 999}]]}]}))
        self.prepare("transform_matrix: expected finite numbers, got an object$")
        entry = ('{"file_path":"a.png","w":8,"h":8,"fl_x":8,"camera":%s,"transform_matrix":'
                 '[[1,0,0,0],[0,1,0,0],[0,0,1,0]]}' % wide)
        self.write("capture/transforms.json", '{"frames":[%s]}' % entry)
        self.prepare("camera: expected a name or a number, got an object$")

    @unittest.skipUnless(built_in("calibration"), "needs a build with calibrations of other tools")
    def test_calibrations(self):
        os.makedirs(self.path("capture", "calibration"))
        for video in os.listdir(harness.sample()):
            if video.endswith(".mp4"):
                shutil.copy(os.path.join(harness.sample(), video), self.path("capture", video))
        for name, text in (
                ("Calib.toml", "a = " + DEEP + "\n"),
                ("Calib.toml", "[" + ".".join(["a"] * DEPTH) + "]\nmatrix = 1\n"),
                ("Calib.toml", ".".join(["a"] * DEPTH) + " = 1\n"),
                ("Calib.qca.txt", "<calibration>" + "<a>" * DEPTH + "</a>" * DEPTH + "</calibration>")):
            with self.subTest(name=name, text=text[:20]):
                self.write("capture/calibration/" + name, text)
                self.prepare(f"{name}: ")
                os.remove(self.path("capture", "calibration", name))


if __name__ == "__main__":
    unittest.main()
