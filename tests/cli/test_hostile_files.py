# SPDX-License-Identifier: Apache-2.0
"""Small files that state much: memory is limited, and work grows with the bytes of the file."""
import functools
import json
import os
import resource
import signal
import struct
import subprocess
import sys
import time
import unittest
import zipfile
import zlib

import harness
from harness import CliTest, built_in, png

USAGE, INVALID, UNSUPPORTED = 1, 3, 5
GIB = 1 << 30
SECONDS = 30  # for runs that take less than one, and took minutes


def jpeg(*segments):
    return b"\xff\xd8" + b"".join(segments) + b"\xff\xd9"


def frame_header(width, height):
    return b"\xff\xc2" + struct.pack(">HBHHB", 11, 8, height, width, 1) + b"\1\x11\0"


SCAN = b"\xff\xda" + struct.pack(">HB", 8, 1) + b"\1\0\0\0\0" + b"\0"


@functools.cache
def repeated_byte(size):
    """Returns a ZIP block of zeros. The predictor of differences: 128 repeats the byte before."""
    return zlib.compress(b"\0" + b"\x80" * (size - 1), 9)


def exr(width, names, height=16, attributes=b""):
    """Returns an EXR file of one ZIP block of floats that are all 0."""
    def attribute(name, kind, value):
        return name + b"\0" + kind + b"\0" + struct.pack("<i", len(value)) + value
    channels = b"".join(name + b"\0" + struct.pack("<iBxxxii", 2, 0, 1, 1) for name in sorted(names)) + b"\0"
    box = struct.pack("<4i", 0, 0, width - 1, height - 1)
    header = (struct.pack("<II", 20000630, 2) + attributes + attribute(b"channels", b"chlist", channels) +
              attribute(b"compression", b"compression", b"\3") + attribute(b"dataWindow", b"box2i", box) +
              attribute(b"displayWindow", b"box2i", box) + attribute(b"lineOrder", b"lineOrder", b"\0") +
              attribute(b"pixelAspectRatio", b"float", struct.pack("<f", 1)) +
              attribute(b"screenWindowCenter", b"v2f", struct.pack("<2f", 0, 0)) +
              attribute(b"screenWindowWidth", b"float", struct.pack("<f", 1)) + b"\0")
    size = 4 * width * len(names)
    blocks, offsets, at = b"", b"", len(header) + 8 * (-(-height // 16))
    for y in range(0, height, 16):
        rows = min(16, height - y)
        data = repeated_byte(size * rows)
        offsets += struct.pack("<Q", at + len(blocks))
        blocks += struct.pack("<ii", y, len(data)) + data
    return header + offsets + blocks


@unittest.skipUnless(built_in("exr"), "needs a build with OpenEXR")
class HostileExr(CliTest):
    MORE = [b"x%05d" % i for i in range(57)]

    def compare(self, code, message, name, *more):
        return self.fails(code, message, "compare", name, name, *more, preexec_fn=lambda: limit_memory(1))

    def test_blocks_are_limited_by_memory(self):
        self.write("a.exr", exr(20000, [b"R", b"G", b"B", *self.MORE]))
        self.compare(UNSUPPORTED, "a.exr: 20000x16 pixels .*larger --memory", "a.exr", "--memory", "64M")
        self.write("b.exr", exr(200, [b"R", b"G", b"B", *self.MORE], 40))
        self.succeeds("compare", "b.exr", "b.exr", "--memory", "64M")

    def test_channels_are_limited(self):
        self.write("a.exr", exr(100, [b"R", b"G", b"B"] + [b"x%05d" % i for i in range(1500)]))
        self.compare(UNSUPPORTED, r"a.exr: has 1503 channels \(at most 64\)", "a.exr")

    def test_files_of_several_parts_are_refused(self):
        """OpenEXR reads the tables of all parts."""
        data = exr(16, [b"R", b"G", b"B"])
        self.write("a.exr", data[:4] + struct.pack("<I", 2 | 0x1000) + data[8:])
        self.compare(UNSUPPORTED, "a.exr: has several EXR parts", "a.exr")

    def test_attributes_are_within_the_file(self):
        vector = b"v\0floatvector\0" + struct.pack("<i", 2**31 - 4)
        self.write("a.exr", exr(16, [b"R", b"G", b"B"], attributes=vector))
        self.compare(INVALID, "a.exr: cannot read EXR: the header is truncated", "a.exr")

    def test_a_signal_ends_decoding(self):
        self.write("a.exr", exr(8000, [b"R", b"G", b"B", *self.MORE], 2000))
        process = subprocess.Popen([harness.STGS, "compare", "a.exr", "a.exr"], cwd=self.work,
                                   stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        self.addCleanup(process.stderr.close)
        time.sleep(1)
        self.assertIsNone(process.poll(), "the run decodes")
        process.send_signal(signal.SIGINT)
        begin = time.monotonic()
        self.assertEqual(process.wait(SECONDS), 4)
        self.assertLess(time.monotonic() - begin, 2)
        self.assertRegex(process.stderr.read().decode(), "interrupted by SIGINT: the comparison is not complete")


class HostileImages(CliTest):
    def compare(self, code, message, name, *more):
        return self.fails(code, message, "compare", name, name, *more, preexec_fn=lambda: limit_memory(2))

    def test_data_that_expands_beyond_the_image_is_refused(self):
        self.write("a.png", png(16, 16, bytes(200_000_000)))
        self.compare(INVALID, "a.png: cannot decode the image", "a.png")

    def test_scans_and_sizes_of_jpeg_files(self):
        self.write("a.jpg", jpeg(frame_header(4096, 4096), SCAN * 20000))
        self.compare(INVALID, "a.jpg: the JPEG file has 20000 scans", "a.jpg")
        self.write("b.jpg", jpeg(frame_header(20000, 20000), frame_header(64, 64), SCAN))
        self.compare(INVALID, "b.jpg: the JPEG file states its size 2 times", "b.jpg")

    def test_images_are_limited_by_memory(self):
        self.write("a.png", png(2000, 2000, bytes(2000 * 6001)))
        self.compare(UNSUPPORTED, "a.png: 2000x2000 pixels .*larger --memory", "a.png", "--memory", "16M")
        self.succeeds("compare", "a.png", "a.png", "--memory", "1G")

    def test_camera_files_are_limited_and_never_waited_for(self):
        os.mkfifo(self.path("camera.json"))
        arguments = ["render", self.fixture("tiny.stgs"), "--time", "0", "-o", "null", "--camera"]
        self.fails(2, "camera.json: cannot open camera file: not a regular file", *arguments, "camera.json")
        self.write("large.json", b" " * 2_000_000)
        self.fails(INVALID, "large.json: a camera file of 2000000 bytes", *arguments, "large.json")


class HostileScenes(CliTest):
    @classmethod
    def setUpClass(cls):
        sys.path.insert(0, os.path.join(harness.SOURCE, "tests", "conformance"))
        import vector_file
        import vector_records
        import vector_scenes
        cls.file, cls.records, cls.scenes = vector_file, vector_records, vector_scenes

    def validate(self, name, timeout=SECONDS):
        return subprocess.run([harness.STGS, "validate", name], cwd=self.work, timeout=timeout,
                              capture_output=True, text=True, check=False)

    def one_primitive(self, **more):
        body = self.records.Body(self.scenes.float_streams(1, 0, 1), 1)
        run = self.file.Run([self.file.Segment(-1, 0, [body])])
        return self.file.File([run], **more)

    def test_images_of_the_start_camera_are_limited(self):
        meta = self.file.Meta(profile=0, size=(32768, 32768), lens=(20000, 20000, 16384, 16384))
        self.write("a.stgs", self.one_primitive(meta=meta).bytes())
        too_large = "a.stgs: .*image of 32768x32768 pixels needs .*--memory"
        for output in "null", "a.exr":
            with self.subTest(output=output):
                self.fails(UNSUPPORTED, too_large + "|--size.*--memory", "render", "a.stgs", "--time",
                           "0", "-o", output, preexec_fn=lambda: limit_memory(4))
        self.fails(UNSUPPORTED, "a.stgs: .*32768x32768 pixels needs .*--memory", "compare", "a.stgs",
                   "a.stgs", "--backend", "cpu", "--memory", "4G", preexec_fn=lambda: limit_memory(4))
        self.succeeds("render", "a.stgs", "--time", "0", "--size", "64x64", "-o", "null",
                      "--memory", "1M")

    def test_images_that_are_compared_are_limited_together(self):
        """99 bytes per pixel: one image, and a third of the rest for the frames of a renderer."""
        meta = self.file.Meta(profile=0, size=(4096, 1024), lens=(4000, 4000, 2048, 512))
        self.write("a.stgs", self.one_primitive(meta=meta).bytes())
        compare = ["compare", "a.stgs", "a.stgs", "--backend", "cpu", "--num-frames", "1", "--memory"]
        self.fails(UNSUPPORTED, "a.stgs: comparing images of 4096x1024 pixels needs 416 MB, more than the memory limit "
                   "of 268 MB; .*--memory", *compare, "256M")
        with subprocess.Popen([harness.STGS, *compare, "400M"], cwd=self.work, stdout=subprocess.DEVNULL) as process:
            _, status, usage = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
        self.assertEqual(process.returncode, 0)
        self.assertLess(usage.ru_maxrss, 400_000)

    def test_captured_frames_are_limited_beside_a_render(self):
        folder = self.copy_capture("capture")
        with open(os.path.join(folder, "capture.json"), encoding="utf-8") as file:
            capture = json.load(file)
        for camera in capture["cameras"]:
            camera.update(width=16384, height=1, cx=8192, cy=0.5)
            self.write(f"capture/frames/{camera['name']}/000000.png", png(16384, 1, bytes(16384 * 3 + 1)))
        self.write("capture/capture.json", json.dumps(capture))
        arguments = ["render", self.fixture("tiny.stgs"), "--cameras", folder, "--frames", "0:1",
                     "--side-by-side", "-o", "out.png", "--memory", "64M"]
        for size, message in ("320x240", "image of 3932480x240 .*leave out --side-by-side"), (
                "16384x80", "image of 1327104x80 .*larger --memory"):
            with self.subTest(size=size):
                self.fails(UNSUPPORTED, f"capture: camera 'c': .*{message}", *arguments, "--size", size,
                           preexec_fn=lambda: limit_memory(2))

    def test_memory_does_not_grow_with_the_stated_frames(self):
        meta = self.file.Meta(profile=0, frames=2**31 - 1, size=(16, 16), lens=(16, 16, 8, 8))
        self.write("a.stgs", self.one_primitive(meta=meta).bytes())
        self.fails(USAGE, "holds one image, not 2147483647", "render", "a.stgs", "--frames", "0:", "-o",
                   "a.png", preexec_fn=lambda: limit_memory(2))

    def test_values_that_overflow_are_errors_of_the_file(self):
        """Not of an argument, although a caller of the library states the same error."""
        streams = self.scenes.float_streams(4, 0, 1)
        for stream in streams:
            value = {2: -3e38, 4: 3e38, 5: 3e38}.get(stream.attribute)
            if value:
                stream.v = [[self.records.bits_of(value)] * len(row) for row in stream.v]
        run = self.file.Run([self.file.Segment(-1, 0, [self.records.Body(streams, 4)])])
        self.write("a.stgs", self.file.File([run], meta=self.file.Meta(profile=0)).bytes())
        self.succeeds("validate", "a.stgs")
        for arguments in (["convert", "a.stgs", "b.ply", "--time", "0.5"],
                          ["convert", "a.stgs", "b.stgs", "--time", "0.5"],
                          ["convert", "a.stgs", "b.stgs", "--quality", "60"]):
            with self.subTest(arguments=arguments):
                self.fails(INVALID, "a.stgs: cannot be converted: .*finite", *arguments)
        self.fails(INVALID, "a.stgs: cannot be packed: .*finite", "pack", "a.stgs", "-o", "b.stgs")

    def test_an_index_with_too_many_records_advises_no_memory(self):
        sys.path.insert(0, os.path.join(harness.SOURCE, "tests", "resources"))
        import hostile
        self.write("a.stgs", hostile.entries(300_000, segments=1000, tiers=1, long=1))
        result = self.fails(UNSUPPORTED, "records for the .* download it again", "info", "a.stgs")
        self.assertNotIn(b"--memory", result.stderr)

    def test_the_validator_lists_a_limited_number_of_problems(self):
        sys.path.insert(0, os.path.join(harness.SOURCE, "tests", "resources"))
        import hostile
        self.write("a.stgs", hostile.unlisted_segments(300_000, 4))
        result = self.stgs("validate", "a.stgs", "--format", "json")
        issues = json.loads(result.stdout)["files"][0]["issues"]
        self.assertEqual(len(issues), 5001)
        self.assertEqual([issues[0]["number"], issues[-1]["number"]], [310, 99])
        self.assertRegex(issues[-1]["message"], "^[0-9]+ more problems")

    def test_many_private_names_and_numbers(self):
        names, layouts = 39000, 85000 // 255
        private = struct.pack("<H", names) + b"".join(
            struct.pack("<HH", 0, i % 0x3FFF) + self.records.text("a") for i in range(names))
        row = struct.pack("<H", 5) + struct.pack("<HBBB", 0xFFFF, 0, 0, 0)
        table = struct.pack("<HH", 0, layouts) + (b"\xff" + row * 255) * layouts
        self.write("a.stgs", self.one_primitive(
            meta=self.file.Meta(profile=0), layouts=table,
            last_records=self.records.record(b"PRIV", private, 0)).bytes())
        result = self.validate("a.stgs")
        self.assertEqual(result.returncode, INVALID, result.stderr)
        self.assertEqual(result.stdout.count("private attribute 0xffff is not named"), 1)

    def test_many_copies_of_one_node(self):
        number, record = self.records.number, self.records.record
        page = number(0) + number(0) + bytes(480000)
        links, at = 10000, 0
        for _ in range(9):  # until the length of the index is that of its own offsets
            index = number(0) + number(0) + number(links) + b"".join(
                struct.pack("<dd", 0, 30) + number(at) + number(at + 1 + i) + number(len(page))
                for i in range(links)) + number(0)
            records = record(b"META", self.file.Meta(profile=1, frames=30).payload()) + \
                record(b"INDX", index)
            if 32 + len(records) == at:
                break
            at = 32 + len(records)
        body = record(b"PAGE", page) + record(
            b"aaaa", self.records.text("a") + bytes(len(page) + links), 0)
        self.write("a.stgs", self.file.header(2, 0, 0, at + len(body), at) + records + body)
        result = self.validate("a.stgs")
        self.assertEqual(result.returncode, INVALID, result.stderr)
        self.assertIn("10000 links lead to one record", result.stdout)
        self.assertEqual(result.stdout.count("copies of nodes overlap"), 1)


def limit_memory(gib):
    resource.setrlimit(resource.RLIMIT_AS, (gib * GIB, gib * GIB))


@unittest.skipUnless(built_in("sog"), "needs a build with SOG")
class HostileModels(CliTest):
    # Lossless WebP of 1 x 1 pixel.
    PIXEL = bytes.fromhex("524946461a000000574542505650384c0d0000002f00000010071011118888fe0700")

    def write_model(self, name, count, **more):
        codebook = {"codebook": [i / 256 for i in range(256)]}
        corners = {"mins": [0, 0, 0], "maxs": [1, 1, 1]}
        meta = {"version": 2, "count": count, "means": {**corners, "files": ["l.webp", "u.webp"]},
                "scales": {**codebook, "files": ["s.webp"]}, "quats": {"files": ["q.webp"]},
                "sh0": {**codebook, "files": ["c.webp"]}, **more}
        with zipfile.ZipFile(self.path(name), "w") as file:
            file.writestr("meta.json", json.dumps(meta))
            for image in "l", "u", "s", "q", "c":
                file.writestr(image + ".webp", self.PIXEL)

    def test_counts_beyond_the_images_allocate_nothing(self):
        codebook = {"codebook": [1] * 256}
        motion = {"mins": [0, 0, 0], "maxs": [1, 1, 1], "files": ["l.webp", "u.webp"], "degree": 1}
        for name, more in (
                ("a.sog", {}), ("a.tsog", {"version": 4}),
                ("a.sogst", {"version": 1, "format": "sogst",
                             "time": {"min": 0, "max": 1, "fps": 10}, "motion": motion,
                             "trbf": {"center": codebook, "sigma": codebook, "files": ["s.webp"]}})):
            with self.subTest(name=name):
                self.write_model(name, 100000000, **more)
                self.fails(INVALID, r"l.webp: image too small \(1 x 1 pixels for 100000000 splats\)$",
                           "convert", name, "out.stgs", preexec_fn=lambda: limit_memory(4))


class MemoryOptions(CliTest):
    def test_verbs_pass_the_limit_to_the_reader(self):
        scene = self.fixture("tiny.stgs")
        ply = "ply\nformat ascii 1.0\nelement vertex 20000\n" + "".join(
            f"property float {name}\n" for name in
            "x y z scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3 opacity f_dc_0 f_dc_1 f_dc_2"
            .split()) + "end_header\n" + "0 0 0 0 0 0 1 0 0 0 1 0 0 0\n" * 20000
        self.write("many.ply", ply)
        self.succeeds("convert", "many.ply", "many.stgs")
        self.fails(UNSUPPORTED, r"many.ply: .* exceed the memory limit of 1048576 bytes \(need \d+ "
                   "bytes\\); use a larger --memory", "convert", "many.ply", "out.stgs", "--memory", "1M")
        for arguments in (("convert", "many.ply", "out.stgs"), ("convert", "many.stgs", "out.stgs"),
                          ("pack", "many.stgs", "-o", "out.stgs")):
            with self.subTest(arguments=arguments):
                self.fails(UNSUPPORTED, "memory", *arguments, "--memory", "1M")
                self.assertFalse(os.path.exists(self.path("out.stgs")))
        result = self.fails(INVALID, "1 error", "validate", "many.stgs", "--memory", "1M")
        self.assertIn(b"issue 308", result.stdout)
        for arguments in ("validate", scene), ("compare", scene, scene):
            self.succeeds(*arguments, "--memory", "64M")


if __name__ == "__main__":
    unittest.main()
