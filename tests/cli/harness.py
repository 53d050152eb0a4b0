# SPDX-License-Identifier: Apache-2.0
"""Shared by the command-line tests: the program, the fixtures, and checks of a run."""
import json
import os
import re
import shutil
import struct
import subprocess
import tempfile
import unittest
import zlib

STGS = ""  # the program, set by run.py
FIXTURE = ""  # folder written by make_fixture; tests never modify it
SOURCE = ""  # the project's root


def sample():
    """Returns the path of the sample capture in the source tree."""
    return os.path.join(SOURCE, "tests", "data", "workshop")


def png(width, height, data, colours=2):
    """Returns an 8-bit PNG with these filtered rows, of colour type `colours` (0: grey, 2: RGB)."""
    def chunk(kind, content):
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, colours, 0, 0, 0)) +
            chunk(b"IDAT", zlib.compress(data)) + chunk(b"IEND", b""))


def built_in(part):
    """Returns whether `stgs --version` lists an optional part."""
    text = subprocess.run([STGS, "--version"], capture_output=True, text=True, check=True).stdout
    return part in re.search(r"built in:(.*)", text).group(1).split()


def renders_with(backend):
    """Returns whether `stgs --version` lists a rendering backend."""
    text = subprocess.run([STGS, "--version"], capture_output=True, text=True, check=True).stdout
    return backend in re.search(r"renders with:(.*)", text).group(1).split()


class CliTest(unittest.TestCase):
    """A test whose runs have a working directory of their own, self.work."""

    def setUp(self):
        self.work = tempfile.mkdtemp(prefix="stgs-cli-")
        self.addCleanup(shutil.rmtree, self.work, True)

    def path(self, *parts):
        return os.path.join(self.work, *parts)

    def fixture(self, name):
        return os.path.join(FIXTURE, name)

    def copy_capture(self, name):
        """Copies the prepared capture into self.work and returns its path."""
        shutil.copytree(self.fixture("prepared"), self.path(name))
        return self.path(name)

    def write(self, name, data):
        with open(self.path(name), "wb") as file:
            file.write(data if isinstance(data, bytes) else data.encode())
        return self.path(name)

    def read(self, name):
        with open(self.path(name), "rb") as file:
            return file.read()

    def stgs(self, *args, **options):
        options.setdefault("stdout", subprocess.PIPE)
        return subprocess.run([STGS, *map(str, args)], cwd=self.work, stderr=subprocess.PIPE,
                              timeout=300, check=False, **options)

    def fails(self, code, message, *args, **options):
        """Checks that the run exits with `code` and one error line that matches `message`."""
        result = self.stgs(*args, **options)
        error = result.stderr.decode(errors="replace")
        self.assertEqual(result.returncode, code, f"{args}: {error}")
        lines = [line for line in error.splitlines() if line.startswith(("stgs: error: ", '{"error":'))]
        self.assertEqual(len(lines), 1, f"{args}: one error line, got: {error}")
        if lines[0].startswith("{"):
            self.check_schema("error", json.loads(lines[0]))
            self.assertEqual(json.loads(lines[0])["error"]["exit_code"], code)
        self.assertRegex(lines[0], message)
        self.assert_no_leftovers()
        return result

    def succeeds(self, *args, **options):
        result = self.stgs(*args, **options)
        error = result.stderr.decode(errors="replace")
        self.assertEqual(result.returncode, 0, f"{args}: {error}")
        self.assert_no_leftovers()
        return result

    def json_of(self, *args):
        """Runs a verb and returns its JSON result, checked against the verb's schema."""
        result = self.succeeds(*args, "--format", "json")
        value = json.loads(result.stdout)
        self.check_schema(args[0], value)
        return value

    def check_schema(self, name, value):
        import jsonschema
        with open(os.path.join(SOURCE, "tools", "schema", name + ".json"), encoding="utf-8") as file:
            schema = json.load(file)
        jsonschema.Draft202012Validator.check_schema(schema)
        jsonschema.Draft202012Validator(schema).validate(value)

    def assert_no_leftovers(self):
        for folder, folders, files in os.walk(self.work):
            for name in files + folders:
                self.assertNotIn(".tmp", name, f"temporary file left in {folder}")
