# SPDX-License-Identifier: Apache-2.0
"""Warnings about damage, about values that the target clips, and about content not converted."""
import json
import os
import shutil
import struct
import subprocess
import zlib

import harness
from harness import CliTest

INVALID = 3


def flipped(data, offset):
    return data[:offset] + bytes([data[offset] ^ 0x10]) + data[offset + 1:]


def ply(rows, names):
    header = "".join(f"property float {name}\n" for name in names)
    body = b"".join(struct.pack(f"<{len(names)}f", *row) for row in rows)
    return (f"ply\nformat binary_little_endian 1.0\nelement vertex {len(rows)}\n{header}"
            "end_header\n").encode() + body


class WarningTest(CliTest):
    def vector(self, name):
        """Returns the path of a conformance vector."""
        return os.path.join(harness.SOURCE, "tests", "conformance", "vectors", name + ".stgs")

    def warnings(self, *args):
        return [line for line in self.succeeds(*args).stderr.decode().splitlines()
                if line.startswith("stgs: warning: ")]

    def rewrite_warnings(self, scene):
        """Returns the warnings of each verb that rewrites a scene, by verb."""
        return {"finalize": self.warnings("finalize", scene, "-o", "f.stgs"),
                "convert": self.warnings("convert", scene, "c.stgs"),
                "pack": self.warnings("pack", scene, "-o", "p.stgs")}


class DamagedHeads(WarningTest):
    def test_a_damaged_head_is_read_from_its_copy(self):
        """No data is lost, each verb warns, and finalize restores the original bytes."""
        with open(self.fixture("tiny.stgs"), "rb") as file:
            intact = file.read()
        self.succeeds("convert", self.fixture("tiny.stgs"), "intact.ply", "--time", "0.05")
        for offset in (2, 20, 80):
            self.write("damaged.stgs", flipped(intact, offset))
            for verb, lines in self.rewrite_warnings("damaged.stgs").items():
                self.assertEqual(len(lines), 1, (verb, lines))
                self.assertIn("head is damaged and was read from its copy", lines[0], verb)
            self.assertEqual(self.read("f.stgs"), intact)
            self.succeeds("convert", "damaged.stgs", "repaired.ply", "--time", "0.05")
            self.assertEqual(self.read("repaired.ply"), self.read("intact.ply"))
            self.assertIn(b"issue 118)", self.stgs("validate", "damaged.stgs").stdout)


class DamagedRecordings(WarningTest):
    def test_a_damaged_fragment_loses_its_segments(self):
        """A damaged FRAG record costs the segments that it lists."""
        with open(self.fixture("recorded.stgs"), "rb") as file:
            recording = file.read()
        second = recording.rindex(b"FRAG", 0, recording.rindex(b"FRAG"))
        scene = self.write("lost.stgs", flipped(recording, second + 30))
        for verb, lines in self.rewrite_warnings(scene).items():
            text = "\n".join(lines)
            self.assertIn("index is damaged", text, verb)
            self.assertRegex(text, r"needed at 0\.100 to 0\.200 s is lost .*\d+ bytes", verb)
        info = self.json_of("info", scene)
        self.assertEqual(info["frames"], 6)
        self.assertEqual([(round(s["begin_s"], 3), round(s["end_s"], 3)) for s in info["lost_fragments"]],
                         [(0.1, 0.2)])
        self.assertAlmostEqual(info["complete_s"], 0.1)
        self.assertRegex(self.succeeds("info", scene).stdout.decode(), r"lost +from 0\.100 s to 0\.200 s")
        output = "-o", "out.png"
        self.fails(INVALID, "no data for 0.15 s can be read", "render", scene, "--time", "0.15", *output)
        self.assertFalse(os.path.exists(self.path("out.png")))
        self.assertIn("complete up to 0.100 s", self.warnings("render", scene, "--time", "0.05", *output)[0])

    def test_a_damaged_segment_loses_only_itself(self):
        """A flipped bit costs one record; warnings state its times and bytes."""
        with open(self.fixture("recorded.stgs"), "rb") as file:
            recording = file.read()
        segments = self.json_of("info", self.fixture("recorded.stgs"))["segments"]
        for segment in (segments[0], segments[-1]):
            middle = segment["offset"] + segment["bytes"] // 2
            scene = self.write("damaged.stgs", flipped(recording, middle))
            for verb, lines in self.rewrite_warnings(scene).items():
                self.assertEqual(len(lines), 1, (verb, lines))
                self.assertRegex(lines[0], rf"1 of {len(segments)} tiers of segments \("
                                           rf"{segment['primitives']} primitives\): \d+ bytes, needed at "
                                           rf"{segment['begin_s']:.3f} to ", verb)
            finished = self.json_of("finalize", scene, "-o", "f.stgs")
            self.assertEqual(finished["damaged"], {"segments": 1, "sh": 0})
            self.assertEqual(self.json_of("convert", scene, "c.stgs")["damaged"], finished["damaged"])
            self.assertEqual(self.json_of("pack", scene, "-o", "p.stgs")["damaged"], finished["damaged"])
            self.fails(INVALID, "error", "validate", "f.stgs")  # finalize copies the damage
            self.succeeds("validate", "c.stgs", "p.stgs")
            self.assertEqual(self.json_of("info", "c.stgs")["primitives"], 800 - segment["primitives"])

    def test_finalize_omits_a_damaged_last_fragment(self):
        """finalize omits the last fragment of an unclosed recording if all its segments are
        damaged, and warns."""
        with open(self.fixture("recorded.stgs"), "rb") as file:
            recording = file.read()
        closing = recording.rindex(b"FRAG")
        last = self.json_of("info", self.fixture("recorded.stgs"))["segments"][-1]
        scene = self.write("open.stgs", flipped(recording[:closing], last["offset"] + last["bytes"] // 2))
        report = self.json_of("finalize", scene, "-o", "f.stgs")
        self.assertEqual(report["damaged"]["segments"], 1)
        self.assertEqual((report["frames"], report["primitives"]), (3, 400))
        lines = self.warnings("finalize", scene, "-o", "f.stgs")
        self.assertRegex(lines[0], r"1 of 2 tiers of segments \(400 primitives\)")
        self.succeeds("validate", "f.stgs")

    def test_ignored_trailing_bytes_are_reported(self):
        for verb, lines in self.rewrite_warnings(self.fixture("cut.stgs")).items():
            self.assertEqual(len(lines), 1, verb)
            self.assertIn("1000 bytes after the last complete fragment are ignored", lines[0])


class NotConverted(WarningTest):
    def test_content_that_is_not_copied_is_reported(self):
        """Further records, private records and private numbers are not copied to a rewritten file."""
        expected = {
            "further_alone": ["further records 'audio/opus' of content 200 (org.example.sound)"],
            "private_records": ["'liGT' 'org.example.lights'", "'pose' 'org.example.poses'"],
            "optional_stream": ["primitive attribute 0x8001"],
            "further_reserved": ["further records 'audio/opus' of content 192 (a)", "further records of content 2:",
                                 "further records of content 4:", "further records of content 191:"],
        }
        for name, parts in expected.items():
            for args in (["convert", self.vector(name), "c.stgs"],
                         ["convert", self.vector(name), "c.ply", "--time", "0"],
                         ["pack", self.vector(name), "-o", "p.stgs"]):
                lines = [line for line in self.warnings(*args)
                         if ": not converted: " in line or ": not copied to the output: " in line]
                self.assertEqual(len(lines), len(parts), (args, lines))
                for part in parts:
                    self.assertTrue(any(part in line for line in lines), (part, lines))
        self.assertEqual(self.json_of("convert", self.fixture("tiny.stgs"), "c.stgs")["not_converted"], [])

    def test_a_target_without_units_is_reported(self):
        text = "\n".join(self.warnings("convert", self.vector("metres_and_up"), "a.ply", "--time", "0"))
        self.assertIn("PLY cannot hold the title, the metres per unit, the up direction and the floor", text)

    def test_unmeasured_errors_are_reported(self):
        run = self.succeeds("convert", self.fixture("tiny.stgs"), "a.glb", "--time", "0.1")
        self.assertIn("errors: not measured (glTF cannot be read back)", run.stdout.decode())


class Clipping(WarningTest):
    NAMES = ("x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 "
             "rot_3").split()
    PLAIN = (0, 0, 0, 0, 0, 0, 3, -2, -2, -2, 1, 0, 0, 0)

    def clipped(self, rows, names):
        self.write("a.ply", ply(rows, names))
        return [line for line in self.warnings("convert", "a.ply", "a.spz") if "clipped" in line]

    def test_values_clipped_by_spz_are_reported(self):
        """Clipping is reported even if positions and rotations are exact."""
        big = list(self.PLAIN)
        big[7], big[3] = 20, 50
        lines = self.clipped([self.PLAIN, big], self.NAMES)
        self.assertEqual(len(lines), 2)
        self.assertIn("clipped 1 of 6 log scales to the range of SPZ, -10 to 5.94, by up to 14", lines[0])
        self.assertIn("clipped 1 of 6 colours to the range of SPZ, -0.44 to 1.44, by up to 13.2", lines[1])
        names = self.NAMES[:6] + [f"f_rest_{i}" for i in range(9)] + self.NAMES[6:]
        row = self.PLAIN[:6] + (100,) + 8 * (0,) + self.PLAIN[6:]
        lines = self.clipped([row], names)
        self.assertEqual(len(lines), 1)
        self.assertIn("clipped 1 of 9 SH coefficients to the range of SPZ, -1 to 1, by up to 99", lines[0])
        self.assertEqual(self.clipped([self.PLAIN], self.NAMES), [])


class Terminals(WarningTest):
    def test_control_characters_are_escaped(self):
        """Texts from a file cannot control the terminal; JSON output has them unchanged."""
        self.write("a.ply", ply([Clipping.PLAIN], Clipping.NAMES))
        self.succeeds("convert", "a.ply", "a.stgs")
        data = self.read("a.stgs")
        title = "\x1b[1m\x07\n\u009bü".encode()
        scene = self.write("b.stgs", self.titled(data, title))
        shown = self.succeeds("info", scene).stdout
        self.assertIn(rb"\x1b[1m\x07\x0a\x9b" + "ü".encode(), shown)
        self.assertFalse([byte for byte in shown if byte < 32 and byte != 10])
        self.assertEqual(self.json_of("info", scene)["title"], title.decode())

    def test_json_is_ascii(self):
        name = "a\x9b2J\x7f\u202ex"
        result = self.stgs("info", name, "--format", "json")
        self.assertTrue(result.stderr.isascii() and b"\x7f" not in result.stderr)
        self.assertEqual(json.loads(result.stderr)["error"]["path"], name)

    def test_names_cannot_control_the_terminal(self):
        """Bytes that are not UTF-8, C1 controls, controls of direction, and lines of names."""
        for name, shown in ((b"\x9b31m", rb"\x9b31m"), (b"\xc2\x9b31m", rb"\x9b31m"),
                            (b"\xe0\x80\x9b", rb"\xe0\x80\x9b"), (b"\xed\xa0\x80", rb"\xed\xa0\x80"),
                            ("\u202egpj".encode(), rb"\u202egpj"), ("\u2066".encode(), rb"\u2066"),
                            (b"a\nb", rb"a\x0ab"), ("ü€😀".encode(), "ü€😀".encode())):
            with self.subTest(name=name):
                result = subprocess.run([harness.STGS.encode(), b"info", name + b".stgs"], cwd=self.work,
                                        stderr=subprocess.PIPE, check=False)
                self.assertTrue(result.stderr.startswith(b"stgs: error: " + shown + b".stgs: "), result.stderr)
                path = os.path.join(self.work.encode(), name + b".stgs")
                shutil.copy(self.fixture("tiny.stgs"), path)
                for verb in "info", "validate":
                    result = subprocess.run([harness.STGS.encode(), verb.encode(), name + b".stgs"],
                                            cwd=self.work, stdout=subprocess.PIPE, check=True)
                    self.assertTrue(result.stdout.startswith(shown + b".stgs: "), result.stdout)

    def titled(self, data, title):
        """Returns the file with another title, a shorter generator and valid checksums, without COPY."""
        head_bytes = struct.unpack_from("<I", data, 24)[0]
        out, at = b"", 32
        while at < head_bytes:
            tag, flags, length = struct.unpack_from("<4sIQ", data, at)
            payload = data[at + 24:at + 24 + length]
            if tag == b"META":
                generator = struct.unpack_from("<I", payload, 132)[0]
                old = struct.unpack_from("<I", payload, 136 + generator)[0]
                end = 140 + generator + old
                left = generator + old - len(title)  # offsets in the index stay the same
                self.assertGreaterEqual(left, 0)
                payload = (payload[:132] + struct.pack("<I", left) + payload[136:136 + left] +
                           struct.pack("<I", len(title)) + title + payload[end:])
            header = struct.pack("<4sIQI", tag, flags, len(payload), zlib.crc32(payload))
            out += header + struct.pack("<I", zlib.crc32(header)) + payload
            at += 24 + length
        body = data[head_bytes:len(data) - 24 - struct.unpack("<Q", data[-8:])[0]]
        header = data[:16] + struct.pack("<QI", head_bytes + len(body), head_bytes)
        return header + struct.pack("<I", zlib.crc32(header)) + out + body
