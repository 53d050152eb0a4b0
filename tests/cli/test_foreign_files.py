# SPDX-License-Identifier: Apache-2.0
"""Errors for files of another format name the format and the verb that reads it."""
import json
import os
import struct
import unittest

from harness import CliTest, built_in

INVALID = 3
PLY = b"ply\nformat binary_little_endian 1.0\nelement vertex 0\nend_header\n"


class ForeignFiles(CliTest):
    KINDS = {
        "a.png": (b"\x89PNG\r\n\x1a\n" + bytes(100), "this is a PNG image"),
        "a.mp4": (struct.pack(">I", 32) + b"ftypisom" + bytes(100), "this is an MP4 video"),
        "a.ply": (PLY, "this is a PLY file; convert models with 'stgs convert'"),
        "a.4dgs": (b"\x894DGS1\r\n" + bytes(100),
                   "this is a .4dgs file; convert it with 'stgs convert'"),
        "a.gif": (b"GIF89a" + bytes(100), "this is a GIF image"),
        "a.webp": (b"RIFF" + bytes(4) + b"WEBP" + bytes(100), "this is a WebP image"),
        "a.y4m": (b"YUV4MPEG2 W8 H8\nFRAME\n" + bytes(100), "this is a Y4M video"),
        "a.ckpt": (b"STGSCKP3" + bytes(100), "this is a training checkpoint"),
        "a.html": (b"\n<!Doctype html><title>404</title>" + b" " * 40,
                   "this is an HTML page; check the URL"),
        "a.xml": (b'<?xml version="1.0"?>' + b" " * 40, "this is an XML or HTML file"),
        "a.json": (b'{"stgs_capture": 1}' + b" " * 60, "this is a JSON file"),
        "a.txt": (b"version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 1\n",
                  "this is a Git LFS pointer"),
        "b.txt": (b"no scene " * 50, "this is a text file"),
        "zeros": (bytes(5000), "it begins with zeros"),
    }

    def test_info_names_the_format(self):
        for name, (data, text) in self.KINDS.items():
            with self.subTest(name=name):
                self.write(name, data)
                self.fails(INVALID, rf"error: {name}: not an .stgs file; {text}.*\(byte 0, issue "
                                    r"102\)$", "info", name)

    def test_every_verb_that_reads_scenes_names_the_format(self):
        for name in ("a.png", "a.json"):
            data, text = self.KINDS[name]
            self.write(name, data)
            for verb in (["info", name], ["render", name, "--time", "0", "-o", "null"],
                         ["evaluate", name, "--against", self.fixture("prepared")],
                         ["bench", name], ["bench", name, "--play", "player"],
                         ["bench", name, "--animate"], ["pack", name, "-o", "x.stgs"],
                         ["finalize", name, "-o", "x.stgs"]):
                with self.subTest(verb=verb):
                    self.fails(INVALID, f"{name}: not an .stgs file; {text}", *verb)
        self.fails(INVALID, "this is a PNG image", "convert", "a.png", "x.stgs")
        self.write("b.txt", self.KINDS["b.txt"][0])
        self.fails(INVALID, r"this is a text file; convert reads STGS, FTGS PLY, PLY, SPZ, .*\(byte 0, issue 102\)$",
                   "convert", "b.txt", "x.stgs")
        self.assertFalse(os.path.exists(self.path("x.stgs")))

    @unittest.skipIf(not built_in("play"), "play is not built in")
    def test_play_names_the_format_before_it_opens_a_window(self):
        self.write("a.ply", PLY)
        self.fails(INVALID, "this is a PLY file; convert models with 'stgs convert'", "play", "a.ply")

    def test_validate_lists_the_issue(self):
        self.write("a.png", self.KINDS["a.png"][0])
        result = self.stgs("validate", "a.png", "--format", "json")
        self.assertEqual(result.returncode, INVALID)
        report = json.loads(result.stdout)
        self.check_schema("validate", report)
        self.assertEqual([i["number"] for i in report["files"][0]["issues"]], [102])

    def test_damaged_scenes_are_not_mistaken_for_other_formats(self):
        with open(self.fixture("tiny.stgs"), "rb") as file:
            good = file.read()
        self.write("cut.stgs", good[:100])
        self.fails(INVALID, r"cut.stgs: the file is truncated", "info", "cut.stgs")
        self.write("empty.stgs", b"")
        self.fails(INVALID, r"empty.stgs: too short", "info", "empty.stgs")


if __name__ == "__main__":
    unittest.main()
