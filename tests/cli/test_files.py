# SPDX-License-Identifier: Apache-2.0
"""Damaged, foreign and missing input, and outputs that cannot be written."""
import json
import os
import resource
import shutil
import struct
import unittest
import zlib

import harness
from harness import CliTest

USAGE, IO, INVALID, RUNTIME, UNSUPPORTED, DIFFERS = 1, 2, 3, 4, 5, 7


def flipped(data, at):
    return data[:at] + bytes([data[at] ^ 0x10]) + data[at + 1:]


class TruncatedScene(CliTest):
    def test_what_is_there_plays(self):
        """A download that broke off: info and render use what is there, and say so."""
        with open(self.fixture("tiny.stgs"), "rb") as file:
            good = file.read()
        last = max(s["offset"] + s["bytes"] + s["sh_bytes"]
                   for s in self.json_of("info", self.fixture("tiny.stgs"))["segments"])
        cut = self.write("cut.stgs", good[:last - 1])
        info = self.json_of("info", cut)
        self.assertEqual(info["missing_bytes"], len(good) - last + 1)
        self.assertEqual([s["available"] and s["sh_available"] for s in info["segments"]].count(False), 1)
        self.assertIn("truncated", self.succeeds("info", cut).stdout.decode())
        checked = self.fails(INVALID, "cut.stgs: 1 error", "validate", cut, "--format", "json")
        issues = json.loads(checked.stdout)["files"][0]["issues"]
        self.assertEqual([issue["number"] for issue in issues], [106])
        run = self.succeeds("render", cut, "--time", "0", "-o", "out.png")
        self.assertIn("the file is truncated", run.stderr.decode())
        self.assertTrue(os.path.exists(self.path("out.png")))
        run = self.succeeds("pack", cut, "-o", "packed.stgs")
        self.assertIn("the file is truncated", run.stderr.decode())
        self.assertRegex(run.stderr.decode(), r"cannot read 1 of \d+ segments")


class DamagedSegments(CliTest):
    """The unit of damage is a record: primitives are drawn where only their harmonics are lost."""

    def spans(self, name):
        """Of each segment its records' bytes: primitives, and harmonics or None."""
        for s in self.json_of("info", self.fixture(name))["segments"]:
            base = s["offset"], s["offset"] + s["bytes"]
            yield base, ((s["sh_offset"], s["sh_offset"] + s["sh_bytes"])
                         if s["sh_bytes"] else None)

    def damaged(self, name, which):
        """The fixture `name` with a flipped bit in these records: 0 of primitives, 1 of harmonics."""
        with open(self.fixture(name), "rb") as file:
            data = file.read()
        for records in self.spans(name):
            if records[which]:
                data = flipped(data, sum(records[which]) // 2)
        return self.write(f"damaged_{which}_{name}", data)

    def picture(self, scene, name, time=0.05):
        run = self.stgs("render", scene, "--time", time, "-o", name, "--format", "json")
        self.assertEqual(run.returncode, 0, run.stderr)
        report = json.loads(run.stdout)
        self.check_schema("render", report)
        return report, run.stderr.decode()

    def assert_alike(self, a, b):
        self.succeeds("compare", a, b, "--min-psnr", "60")

    def test_half_of_a_file_is_its_primitives(self):
        with open(self.fixture("steady.stgs"), "rb") as file:
            whole = file.read()
        half = self.write("half.stgs", whole[:len(whole) // 2])
        segments = self.json_of("info", half)["segments"]
        self.assertTrue(all(s["available"] for s in segments))
        self.assertFalse(any(s["sh_available"] for s in segments))
        self.assertIn("3 without SH", self.succeeds("info", half).stdout.decode())
        report, warnings = self.picture(half, "half.png")
        self.assertEqual(report["damaged"], {"segments": 0, "sh": len(segments)})
        self.assertIn("rendered 3 segments without SH", warnings)
        self.picture(self.fixture("steady_plain.stgs"), "plain.png")
        self.picture(self.fixture("steady.stgs"), "whole.png")
        self.assert_alike("half.png", "plain.png")
        self.fails(DIFFERS, "dB", "compare", "half.png", "whole.png", "--min-psnr", "60")
        bench = self.json_of("bench", half, "--num-frames", "2")
        self.assertEqual(bench["damaged"], report["damaged"])
        self.fails(INVALID, "half.stgs: 1 error", "validate", half)

    def test_damaged_harmonics_cost_only_themselves(self):
        self.picture(self.damaged("steady.stgs", 1), "damaged.png")
        self.picture(self.fixture("steady_plain.stgs"), "plain.png")
        self.assert_alike("damaged.png", "plain.png")
        self.fails(INVALID, "error", "validate", "damaged_1_steady.stgs")
        run = self.succeeds("pack", "damaged_1_steady.stgs", "-o", "packed.stgs")
        self.assertRegex(run.stderr.decode(), r"cannot read the SH of (\d+) of \1 .*is damaged")

    def test_damage_in_a_recording(self):
        report, warnings = self.picture(self.damaged("live.stgs", 1), "live.png")
        self.assertGreater(report["damaged"]["sh"], 0)
        self.assertEqual(report["damaged"]["segments"], 0)
        self.assertIn("is damaged", warnings)

    def test_a_picture_of_nothing_is_an_error(self):
        for scene in ("steady.stgs", "live.stgs"):
            damaged = self.damaged(scene, 0)
            for verb in (["render", damaged, "--time", "0.05", "-o", "out.png"],
                         ["bench", damaged, "--num-frames", "1"]):
                self.fails(INVALID, "no data for .* can be read: .*damaged", *verb)
            self.assertFalse(os.path.exists(self.path("out.png")))

    def test_what_is_sound_is_drawn(self):
        with open(self.fixture("packed.stgs"), "rb") as file:
            data = file.read()
        first = next(self.spans("packed.stgs"))[0]
        scene = self.write("one.stgs", flipped(data, sum(first) // 2))
        report, warnings = self.picture(scene, "one.png", 0.15)  # of two segments
        self.assertEqual(report["damaged"], {"segments": 1, "sh": 0})
        self.assertIn("skipped 1 damaged segment", warnings)


class DamagedScenes(CliTest):
    def setUp(self):
        super().setUp()
        with open(self.fixture("tiny.stgs"), "rb") as file:
            self.good = file.read()

    def test_files_that_no_verb_opens(self):
        without_copy = flipped(self.good, len(self.good) - 20)  # a right one of the head
        cases = [
            (IO, "missing.stgs: cannot open: No such file", self.path("missing.stgs")),
            (IO, "not a regular file", self.work),
            (IO, "not a regular file", "/dev/null"),
            (INVALID, "empty.stgs: too short for an .stgs file", self.write("empty.stgs", b"")),
            (INVALID, "short.stgs: too short for an .stgs file \(expected at least 40 bytes, got 17", self.write("short.stgs", self.good[:17])),
            (INVALID, "cut.stgs: the file is truncated within its head .*got 100",
             self.write("cut.stgs", self.good[:100])),
            (INVALID, "text.stgs: not an .stgs file", self.write("text.stgs", "no scene " * 50)),
            (INVALID, "magic.stgs: not an .stgs file",
             self.write("magic.stgs", flipped(without_copy, 1))),
            (INVALID, "meta.stgs: record 'META' is damaged",
             self.write("meta.stgs", flipped(without_copy, 80))),
            (UNSUPPORTED, "newer_major.stgs.*unsupported format version \(expected 1.x, got 2.0\)",
             self.fixture("newer_major.stgs")),
            (UNSUPPORTED, "experiment.stgs.*pre-release version 0.6.*create the file again",
             self.fixture("experiment.stgs")),
            (INVALID, "huge_count.stgs.*states 4294967295 primitives",
             self.fixture("huge_count.stgs")),
            (INVALID, "huge_bytes.stgs: .*exceed the body", self.fixture("huge_bytes.stgs")),
            (INVALID, "wrong_sum.stgs: .*primitive count mismatch \(total states 401, segments have 400\)",
             self.fixture("wrong_sum.stgs")),
        ]
        verbs = {
            "info": lambda f: ["info", f],
            "render": lambda f: ["render", f, "--time", "0", "-o", "out.png"],
            "evaluate": lambda f: ["evaluate", f, "--against", self.fixture("prepared")],
            "compare": lambda f: ["compare", f, self.fixture("tiny.stgs")],
        }
        for code, message, path in cases:
            for verb, line in verbs.items():
                with self.subTest(verb=verb, path=path):
                    self.fails(code, message, *line(path))
        self.assertFalse(os.path.exists(self.path("out.png")))

    def test_bytes_behind_the_end_are_told_and_passed_over(self):
        path = self.write("long.stgs", self.good + b"more")
        self.assertEqual([d["number"] for d in self.json_of("info", path)["damage"]], [106])
        self.assertIn("extra bytes after the end of the file", self.succeeds("info", path).stdout.decode())
        self.succeeds("compare", path, self.fixture("tiny.stgs"))
        run = self.succeeds("render", path, "--time", "0", "-o", "null")
        self.assertIn("extra bytes after the end of the file", run.stderr.decode())
        self.fails(INVALID, "1 error", "validate", path)

    def test_damage_in_a_segment_is_found_where_it_is(self):
        """The head is whole, so info works; render passes over it, evaluate does not."""
        last = max(s["offset"] + s["bytes"] for s in self.json_of("info", self.fixture("tiny.stgs"))["segments"])
        path = self.write("body.stgs", flipped(self.good, last - 40))
        self.succeeds("info", path)
        run = self.succeeds("render", path, "--frames", "0:6", "-o", "null")
        self.assertRegex(run.stderr.decode(), r"skipped 1 damaged segment.*body.stgs: .*checksum")
        self.fails(INVALID, r"body.stgs: .*checksum.* \(rendering 0(\.\d+)? s\)$", "evaluate", path,
                   "--against", self.fixture("prepared"))

    @unittest.skipIf(os.environ.get("STGS_SANITIZE"), "a sanitizer reserves more than the limit")
    def test_too_little_memory_is_an_error_that_names_the_file_and_the_moment(self):
        def limit():
            resource.setrlimit(resource.RLIMIT_AS, (2 << 30, 2 << 30))
        self.fails(RUNTIME, r"tiny.stgs: cannot render 0\.1 s: out of memory; .*30000x30000 pixels.*--size",
                   "render", self.fixture("tiny.stgs"), "--time", "0.1", "--size", "30000x30000",
                   "-o", "null", "--threads", "2", preexec_fn=limit)

    def test_start_cameras_that_are_wrong(self):
        for name, message in (("wide_start", "2147483712"), ("skew_start", "rotation")):
            for line in (["render", self.fixture(name + ".stgs"), "--time", "0", "-o", "null"],
                         ["compare", self.fixture(name + ".stgs"), self.fixture("tiny.stgs")]):
                with self.subTest(line=line):
                    self.fails(INVALID, f"{name}.stgs: .*{message}", *line)

    def test_validate_tells_good_from_bad(self):
        good, packed = self.fixture("tiny.stgs"), self.fixture("packed.stgs")
        report = self.json_of("validate", good, packed)
        self.assertTrue(report["valid"])
        for name in ("huge_bytes", "wrong_sum"):
            result = self.fails(INVALID, r"\d+ error", "validate", self.fixture(name + ".stgs"),
                                "--format", "json")
            report = json.loads(result.stdout)
            self.check_schema("validate", report)
            self.assertFalse(report["valid"])
            self.assertGreater(report["files"][0]["issues"][0]["number"], 0)
        result = self.fails(IO, "cannot open", "validate", good, self.path("none.stgs"),
                            "--format", "json")
        report = json.loads(result.stdout)
        self.check_schema("validate", report)
        self.assertTrue(report["files"][0]["valid"])
        self.assertIn("cannot open", report["files"][1]["unreadable"])

    def test_every_flipped_byte_is_an_error(self):
        """Flips at a hundred places; validate must answer 3 at each (5: a newer version)."""
        for i in range(100):
            at = i * (len(self.good) - 1) // 99
            path = self.write("flip.stgs", flipped(self.good, at))
            result = self.stgs("validate", path)
            self.assertIn(result.returncode, (INVALID, UNSUPPORTED), f"byte {at} flipped")


class WrongCaptures(CliTest):
    def evaluate(self, folder):
        return ["evaluate", self.fixture("tiny.stgs"), "--against", folder, "--cameras", "all"]

    def test_folders_that_are_no_prepared_capture(self):
        os.mkdir(self.path("empty"))
        make = "not a prepared capture .*; make one with 'stgs prepare'"
        for folder, message in ((self.path("empty"), make),
                                (self.path("missing"), "missing: no such file or folder"),
                                (self.fixture("tiny.stgs"), make)):
            with self.subTest(folder=folder):
                self.fails(IO, message, *self.evaluate(folder))
        self.fails(IO, "missing.json: no such file or folder", "render", self.fixture("tiny.stgs"),
                   "--cameras", self.path("missing.json"), "--time", "0", "-o", "null")

    def test_capture_json_that_is_wrong(self):
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
            (INVALID, '"width" is -4 .expected 1 to 32768', changed(cameras=[{**camera, "width": -4}])),
            (INVALID, "\"rotation\" has 2 numbers", changed(cameras=[{**camera, "rotation": [1, 0]}])),
            (INVALID, "cannot be a folder name",
             changed(cameras=[{**camera, "name": "../../etc"}])),
        ]
        for i, (code, message, text) in enumerate(cases):
            with self.subTest(message=message):
                folder = self.copy_capture(f"capture{i}")
                self.write(f"capture{i}/capture.json", text)
                self.fails(code, message, *self.evaluate(folder))

    def test_frames_that_are_wrong(self):
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

    def test_camera_files_that_are_wrong(self):
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
            ("fx and fy must be positive", json.dumps({**good, "fx": 0})),
            ("\"height\" is 1000000 .expected 1 to 32768", json.dumps({**good, "height": 1000000})),
            ("not a rotation matrix", json.dumps({**good, "rotation": [2] * 9})),
            ("not a rotation matrix", json.dumps({**good, "rotation": [1, 0, 0, 0, 1, 0, 0, 0,
                                                                       -1]})),
            ("\"rotation\" has 1 number", json.dumps({**good, "rotation": [1]})),
        ]
        for message, text in cases:
            with self.subTest(message=message):
                self.fails(INVALID, message, *render(self.write("camera.json", text)))

    def test_pictures_that_are_wrong(self):
        bad = self.write("bad.png", b"not a picture")
        self.fails(INVALID, "bad.png: cannot decode the image", "compare", bad, bad)
        self.fails(IO, "none.png: cannot open", "compare", self.path("none.png"), bad)

        def png(width, height):
            """The signature and head of a PNG, which state its size."""
            body = b"IHDR" + struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
            return b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + body + struct.pack(
                ">I", zlib.crc32(body))
        wide = self.write("wide.png", png(40000, 10))
        self.fails(INVALID, "wide.png: invalid image size 40000x10", "compare", wide, wide)
        large = self.write("large.png", png(17000, 17000))
        self.fails(UNSUPPORTED, "large.png: image too large: 17000x17000", "compare", large, large)
        os.truncate(wide, (1 << 32) + 100)  # a hole: takes no room
        self.fails(UNSUPPORTED, "wide.png: image file too large: 4294967396 bytes", "compare", wide, wide)


class Outputs(CliTest):
    def test_packing_a_scene_onto_itself_is_refused(self):
        shutil.copy(self.fixture("tiny.stgs"), self.path("scene.stgs"))
        size = os.path.getsize(self.path("scene.stgs"))
        os.link(self.path("scene.stgs"), self.path("same.stgs"))
        for output in ("scene.stgs", "./scene.stgs", "same.stgs"):
            self.fails(USAGE, "is the input scene itself", "pack", "scene.stgs", "-o", output)
        self.assertEqual(os.path.getsize(self.path("scene.stgs")), size)

    def render(self, output, *more):
        return ["render", self.fixture("tiny.stgs"), "--frames", "0:1", "-o", output, *more]

    def test_places_that_cannot_be_written(self):
        self.write("file", b"")
        os.symlink("/dev/full", self.path("full.png"))
        cases = [
            ("folder 'nowhere' does not exist", "nowhere/out.png"),
            ("'file' is not a folder", "file/out.png"),
            ("'.*prepared' is not a folder|does not exist", "file/more/out.png"),
            ("cannot create", "/proc/out.png"),
            ("exists and is not a regular file", "full.png"),
            ("cannot create|does not exist", "/proc/folder/"),
        ]
        for message, output in cases:
            with self.subTest(output=output):
                self.fails(IO, message, *self.render(output))
        for name in ("out.y4m", "out.mp4", "out.exr"):
            with self.subTest(name=name):
                self.fails(IO, "cannot create", *self.render("/proc/" + name))

    def test_a_full_disk_leaves_the_old_output(self):
        """A limit on the size of files acts as a full disk does, for any user."""
        def limit():
            resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))
        size = ["--size", "640x480", "--log-level", "error"]
        for name in ("out.png", "out.y4m", "out.exr", "out.mp4"):
            part = {"out.exr": "exr", "out.mp4": "mp4"}.get(name)
            if part and not harness.built_in(part):
                continue
            with self.subTest(name=name):
                self.write(name, b"old")
                result = self.stgs(*self.render(name, *size), preexec_fn=limit)
                self.assertEqual(result.returncode, IO, result.stderr)
                self.assertIn(f"{name}: cannot write".encode(), result.stderr)
                self.assertEqual(self.read(name), b"old")
                self.no_leftovers()
        result = self.stgs(*self.render("frames/", *size), preexec_fn=limit)
        self.assertEqual(result.returncode, IO, result.stderr)
        self.assertFalse(os.path.exists(self.path("frames")))
        self.no_leftovers()

    def test_standard_output_that_is_full(self):
        with open("/dev/full", "wb") as full:
            self.fails(IO, "standard output: cannot write: No space left", "info",
                       self.fixture("tiny.stgs"), stdout=full)
            self.fails(IO, "standard output: cannot write: No space left",
                       *self.render("-", "--size", "320x240"), stdout=full)

    def test_a_reader_that_goes_away(self):
        read, write = os.pipe()
        os.close(read)
        with os.fdopen(write, "wb") as pipe:
            self.fails(IO, "standard output: cannot write: Broken pipe",
                       *self.render("-", "--size", "320x240"), stdout=pipe)

    def test_outputs_are_replaced(self):
        self.write("out.png", b"old")
        self.succeeds(*self.render("out.png"))
        self.assertTrue(self.read("out.png").startswith(b"\x89PNG"))
        self.succeeds(*self.render("frames/"))
        self.write("frames/000000.png", b"old")
        self.write("frames/notes.txt", b"mine")
        self.succeeds(*self.render("frames/"))
        self.assertTrue(self.read("frames/000000.png").startswith(b"\x89PNG"))
        self.assertEqual(self.read("frames/notes.txt"), b"mine")


if __name__ == "__main__":
    unittest.main()
