# SPDX-License-Identifier: Apache-2.0
"""stgs serve: the page, ranges and conditions, refusals. Its clients: test_serve_clients.py."""
import contextlib
import email.utils
import http.client
import json
import os
import shutil
import socket
import struct
import subprocess
import time
import unittest
import zlib

import harness
from harness import CliTest, built_in

USAGE, IO, INVALID, RUNTIME, NOT_BUILT = 1, 2, 3, 4, 6
TIMEOUT = 40          # of a client, seconds: longer than the server's limits


def extend_head(path, more):
    """Adds an optional record with `more` zeros to the head of a scene."""
    with open(path, "rb") as file:
        scene = file.read()
    zeros = bytes(more)
    record = struct.pack("<IIQI", int.from_bytes(b"ZZZZ", "little"), 0, more, zlib.crc32(zeros))
    record += struct.pack("<I", zlib.crc32(record)) + zeros
    *versions, file_bytes, head_bytes = struct.unpack("<HHIQI", scene[8:28])
    header = scene[:8] + struct.pack("<HHIQI", *versions, file_bytes + len(record), head_bytes + len(record))
    header += struct.pack("<I", zlib.crc32(header))
    with open(path, "wb") as file:
        file.write(header + scene[32:head_bytes] + record + scene[head_bytes:])


class Reply:
    def __init__(self, response):
        self.status, self.headers = response.status, response.headers
        self.body = response.read()

    def __getitem__(self, name):
        return self.headers.get(name)


class Server(CliTest):
    """Tests with a server of self.path("scenes")."""

    def setUp(self):
        super().setUp()
        os.mkdir(self.path("scenes"))
        self.scene = self.path("scenes", "tiny.stgs")
        shutil.copy(self.fixture("tiny.stgs"), self.scene)
        an_hour_ago = time.time() - 3600
        os.utime(self.scene, (an_hour_ago, an_hour_ago))
        with open(self.scene, "rb") as file:
            self.bytes = file.read()

    def start(self, *args):
        """Starts a server; returns it and its description."""
        server = subprocess.Popen([harness.STGS, "serve", *args, "--format", "json"], cwd=self.work,
                                  stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.addCleanup(self.stop, server)
        lines = []
        while not lines or lines[-1] != "}\n":
            lines.append(server.stdout.readline())
            self.assertNotEqual(lines[-1], "", lines)
        about = json.loads("".join(lines))
        self.check_schema("serve", about)
        self.port = about["port"]
        return server, about

    @staticmethod
    def stop(server):
        if server.poll() is None:
            server.kill()
        server.wait()
        server.stdout.close()
        server.stderr.close()

    def ask(self, path, method="GET", **headers):
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=TIMEOUT)
        try:
            headers = {name.replace("_", "-"): value for name, value in headers.items()}
            connection.request(method, path, headers=headers)
            return Reply(connection.getresponse())
        finally:
            connection.close()

    def add_audio(self, location, name="loud.stgs"):
        """Adds a scene that names an audio file to the folder."""
        self.succeeds("pack", self.scene, "-o", "scenes/" + name, "--audio", location, "--log-level", "error")

    def raw(self, request):
        """Sends bytes; returns all that is answered until the server ends the connection."""
        with socket.create_connection(("127.0.0.1", self.port), TIMEOUT) as client:
            client.sendall(request)
            answer = b""
            with contextlib.suppress(ConnectionError):
                while data := client.recv(65536):
                    answer += data
            return answer


@unittest.skipUnless(built_in("serve"), "serve is not built in")
class Files(Server):
    def test_a_file_is_served_with_its_page(self):
        _, about = self.start("scenes/tiny.stgs")
        self.assertEqual(about["url"], f"http://127.0.0.1:{self.port}/")
        page = self.ask("/")
        self.assertEqual((page.status, page["Content-Type"]), (200, "text/html; charset=utf-8"))
        self.assertIn(b'{"scene":"scenes/tiny.stgs"}', page.body)
        for name, kind in (("viewer.js", "text/javascript; charset=utf-8"), ("stgs-core.wasm", "application/wasm")):
            reply = self.ask("/" + name)
            self.assertEqual((reply.status, reply["Content-Type"]), (200, kind))
        self.assertEqual(self.ask("/scenes/tiny.stgs").body, self.bytes)
        for path in ("/scenes/other.stgs", "/scenes.json", "/tiny.stgs", "/scenes/", "/x"):
            self.assertEqual(self.ask(path).status, 404, path)
        for reply in (page, self.ask("/nothing"), self.ask("/scenes/tiny.stgs")):
            self.assertEqual(reply["X-Content-Type-Options"], "nosniff")
            self.assertEqual(reply["Cross-Origin-Resource-Policy"], "same-origin")
            self.assertIsNone(reply["Access-Control-Allow-Origin"])

    def test_ranges(self):
        self.start("scenes")
        size = len(self.bytes)
        for text, begin, end in (("0-0", 0, 1), ("100-199", 100, 200), (f"{size - 5}-", size - 5, size),
                                 ("-7", size - 7, size), (f"10-{size + 99}", 10, size), (f"-{size + 9}", 0, size),
                                 ("5-99999999999999999999999", 5, size)):
            with self.subTest(range=text):
                reply = self.ask("/scenes/tiny.stgs", Range=f"bytes={text}")
                self.assertEqual(reply.status, 206)
                self.assertEqual(reply["Content-Range"], f"bytes {begin}-{end - 1}/{size}")
                self.assertEqual(reply.body, self.bytes[begin:end])
        for text in (f"{size}-", "99999999999999999999999-", "-0"):
            with self.subTest(range=text):
                reply = self.ask("/scenes/tiny.stgs", Range=f"bytes={text}")
                self.assertEqual((reply.status, reply["Content-Range"]), (416, f"bytes */{size}"))
        for text in ("bytes=9-3", "bytes=", "bytes=-", "bytes=a-b", "bytes=0-1,3-4", "bytes=+1-2", "items=0-1"):
            with self.subTest(range=text):  # ignored
                reply = self.ask("/scenes/tiny.stgs", Range=text)
                self.assertEqual((reply.status, len(reply.body)), (200, size))

    def test_head_has_the_fields_of_get(self):
        self.start("scenes")
        for headers in ({}, {"Range": "bytes=0-9"}, {"Range": "bytes=99999999-"}):
            get, head = (self.ask("/scenes/tiny.stgs", method, **headers) for method in ("GET", "HEAD"))
            self.assertEqual(head.status, get.status)
            self.assertEqual(head.body, b"")
            for name in ("ETag", "Last-Modified", "Content-Range", "Content-Length", "Accept-Ranges", "Cache-Control"):
                self.assertEqual(head[name], get[name], name)

    def test_conditions(self):
        self.start("scenes")
        first = self.ask("/scenes/tiny.stgs")
        tag, date = first["ETag"], first["Last-Modified"]
        self.assertRegex(tag, '^"[^"]+"$')
        self.assertEqual(email.utils.parsedate_to_datetime(date).timestamp(), int(os.stat(self.scene).st_mtime))
        self.assertEqual(first["Cache-Control"], "no-cache")
        cases = [({"If_None_Match": tag}, 304), ({"If_None_Match": f'"a", W/{tag}'}, 304),
                 ({"If_None_Match": "*"}, 304), ({"If_None_Match": '"a"'}, 200),
                 ({"If_Modified_Since": date}, 304), ({"If_Modified_Since": "Thu, 01 Jan 1970 00:00:00 GMT"}, 200),
                 ({"If_None_Match": '"a"', "If_Modified_Since": date}, 200),
                 ({"If_Match": tag}, 200), ({"If_Match": '"a"'}, 412), ({"If_Match": f"W/{tag}"}, 412),
                 ({"Range": "bytes=0-1", "If_Range": tag}, 206), ({"Range": "bytes=0-1", "If_Range": date}, 206),
                 ({"Range": "bytes=0-1", "If_Range": '"a"'}, 200), ({"Range": "bytes=0-1", "If_Range": "W/" + tag}, 200)]
        for headers, status in cases:
            with self.subTest(headers=headers):
                self.assertEqual(self.ask("/scenes/tiny.stgs", **headers).status, status)

    def test_a_growing_file_is_served_while_it_is_written(self):
        self.start("scenes")
        with open(self.path("scenes", "live.stgs"), "wb", buffering=0) as file:
            tags = set()
            for part in range(4):
                file.write(bytes([part]) * 1000)
                reply = self.ask("/scenes/live.stgs", Range=f"bytes={1000 * part}-")
                self.assertEqual(reply.body, bytes([part]) * 1000)
                self.assertEqual(reply["Content-Range"], f"bytes {1000 * part}-{1000 * part + 999}/{1000 * part + 1000}")
                self.assertEqual(reply["Cache-Control"], "no-store")
                tags.add(reply["ETag"])
            self.assertEqual(len(tags), 4)
            os.truncate(file.fileno(), 10)
            self.assertEqual(self.ask("/scenes/live.stgs", Range="bytes=1000-").status, 416)
        os.truncate(self.path("scenes", "live.stgs"), 0)
        self.assertEqual(self.ask("/scenes/live.stgs").body, b"")
        os.remove(self.path("scenes", "live.stgs"))
        self.assertEqual(self.ask("/scenes/live.stgs").status, 404)

    def test_damage_of_the_scene_is_reported(self):
        server, _ = self.start(self.write("cut.stgs", self.bytes[:-100]))
        server.terminate()
        self.assertIn("warning: ", server.stderr.read())

    def test_the_audio_file_of_the_scene_is_served(self):
        self.add_audio("a%20b.mp3")
        audio = bytes(range(256)) * 20
        self.write("scenes/a b.mp3", audio)
        self.write("scenes/other.mp3", b"secret")
        server, _ = self.start("scenes/loud.stgs")
        whole = self.ask("/scenes/a%20b.mp3")
        self.assertEqual((whole.status, whole["Content-Type"], whole.body), (200, "audio/mpeg", audio))
        part = self.ask("/scenes/a%20b.mp3", Range="bytes=100-199")
        self.assertEqual((part.status, part["Content-Range"], part.body), (206, "bytes 100-199/5120", audio[100:200]))
        head = self.ask("/scenes/a%20b.mp3", "HEAD")
        self.assertEqual((head["Content-Length"], head["Accept-Ranges"]), ("5120", "bytes"))
        for name in ("other.mp3", "a%20b.mp3/", "./a%20b.mp3", "x/../a%20b.mp3", "tiny.stgs", "a%20b.MP3"):
            self.assertEqual(self.ask("/scenes/" + name).status, 404, name)
        self.add_audio("other.mp3")  # the file that is served is replaced
        self.assertEqual(self.ask("/scenes/a%20b.mp3").status, 404)
        self.assertEqual(self.ask("/scenes/other.mp3").body, b"secret")
        server.terminate()
        self.assertNotIn("warning", server.stderr.read())

    def test_a_missing_audio_file_is_reported(self):
        self.add_audio("missing.mp3")
        server, _ = self.start("scenes/loud.stgs")
        self.assertEqual(self.ask("/scenes/loud.stgs").status, 200)
        self.assertEqual(self.ask("/scenes/missing.mp3").status, 404)
        server.terminate()
        self.assertRegex(server.stderr.read(), "warning: .*loud.stgs: the page has no sound: .*missing.mp3' does not exist")

    def test_the_program_plays_what_it_serves(self):
        if not built_in("http"):
            self.skipTest("http is not built in")
        self.start("scenes")
        self.succeeds("validate", f"http://127.0.0.1:{self.port}/scenes/tiny.stgs")
        shutil.copy(self.fixture("live.stgs"), self.path("scenes", "live.stgs"))
        self.succeeds("info", f"http://127.0.0.1:{self.port}/scenes/live.stgs")


@unittest.skipUnless(built_in("serve"), "serve is not built in")
class Refusals(Server):
    def test_only_scenes_below_the_folder_are_served(self):
        self.write("outside.stgs", b"secret")
        self.write("scenes/notes.txt", b"secret")
        self.write("scenes/.hidden.stgs", b"secret")
        os.makedirs(self.path("scenes", ".git"))
        self.write("scenes/.git/a.stgs", b"secret")
        os.makedirs(self.path("scenes", "below"))
        shutil.copy(self.scene, self.path("scenes", "below", "b.stgs"))
        os.symlink("tiny.stgs", self.path("scenes", "inside.stgs"))
        os.symlink("../outside.stgs", self.path("scenes", "link.stgs"))
        os.symlink(self.path("outside.stgs"), self.path("scenes", "absolute.stgs"))
        os.symlink("..", self.path("scenes", "up"))
        os.symlink("/proc/self/cwd", self.path("scenes", "magic"))
        os.mkfifo(self.path("scenes", "pipe.stgs"))
        os.mkdir(self.path("scenes", "folder.stgs"))
        self.start("scenes")
        for name in ("below/b.stgs", "inside.stgs", "below%2Fb.stgs", "tiny%2estgs"):
            self.assertEqual(self.ask("/scenes/" + name).status, 200, name)
        refused = ["notes.txt", ".hidden.stgs", ".git/a.stgs", "link.stgs", "absolute.stgs", "up/outside.stgs",
                   "magic/outside.stgs", "pipe.stgs", "folder.stgs", "../outside.stgs", "%2e%2e/outside.stgs",
                   "..%2foutside.stgs", "below/../tiny.stgs", "below//b.stgs", "/tiny.stgs", "./tiny.stgs", "",
                   "tiny.stgs/", "tiny.stgs%2f", "tiny.stgs/x", self.path("outside.stgs"), "..%5coutside.stgs"]
        for name in refused:
            with self.subTest(name=name):
                reply = self.ask("/scenes/" + name)
                self.assertEqual(reply.status, 404)
                self.assertNotIn(b"secret", reply.body)
        for path in ("/../outside.stgs", "/scenes", "//scenes/tiny.stgs", "/viewer.js/", "/%76iewer.js%20"):
            self.assertEqual(self.ask(path).status, 404, path)
        for path in ("/scenes/tiny%00.stgs", "/scenes/tiny.stgs%00.txt", "/%", "/%2", "/%zz", "/%-1"):
            self.assertEqual(self.ask(path).status, 400, path)
        listed = [scene["name"] for scene in json.loads(self.ask("/scenes.json").body)["scenes"]]
        self.assertEqual(listed, ["below/b.stgs", "inside.stgs", "tiny.stgs"])

    def test_only_audio_files_that_scenes_name_are_served(self):
        self.write("outside.mp3", b"secret")
        os.makedirs(self.path("scenes", "a", "b"))
        os.symlink("../outside.mp3", self.path("scenes", "link.mp3"))
        os.symlink("..", self.path("scenes", "up"))
        os.symlink("../top.mp3", self.path("scenes", "a", "inner.mp3"))
        for name in ("top.mp3", "other.mp3", "notes.txt", ".hidden.mp3", "a/song.mp3", "a/b/deep.ogg", "a/b/other.mp3"):
            self.write("scenes/" + name, name.encode())
        for i, location in enumerate(("top.mp3", "notes.txt", ".hidden.mp3", "link.mp3", "up/outside.mp3",
                                      "../outside.mp3", "a/b/deep.ogg", "http://127.0.0.1/other.mp3")):
            self.add_audio(location, f"{i}.stgs")
        for i, location in enumerate(("b/../song.mp3", "../other.mp3", "inner.mp3")):
            self.add_audio(location, f"a/{i}.stgs")
        self.start("scenes")
        for name in ("top.mp3", "a/song.mp3", "a/b/deep.ogg"):
            self.assertEqual(self.ask("/scenes/" + name).body, name.encode())
        for name in ("notes.txt", ".hidden.mp3", "link.mp3", "up/outside.mp3", "../outside.mp3", "other.mp3",
                     "a/inner.mp3", "a/b/other.mp3", "deep.ogg", "a/b/../song.mp3", "up/scenes/top.mp3"):
            with self.subTest(name=name):
                self.assertEqual(self.ask("/scenes/" + name).status, 404)

    def test_a_scene_with_a_long_head_is_not_searched_for_audio(self):
        for name in ("short", "long"):
            self.write(f"scenes/{name}.mp3", name.encode())
            self.add_audio(f"{name}.mp3", f"{name}.stgs")
        extend_head(self.path("scenes", "long.stgs"), 20 << 20)
        self.start("scenes")
        self.assertEqual(self.ask("/scenes/short.mp3").body, b"short")
        self.assertEqual(self.ask("/scenes/long.mp3").status, 404)

    def test_methods(self):
        self.start("scenes")
        for method in ("POST", "PUT", "DELETE", "OPTIONS", "PATCH", "PROPFIND"):
            reply = self.ask("/scenes/tiny.stgs", method)
            self.assertEqual((reply.status, reply["Allow"]), (405, "GET, HEAD"), method)
        answer = self.raw(b"POST / HTTP/1.1\r\nHost: localhost\r\nContent-Length: 100000\r\n\r\n" + bytes(1000))
        self.assertTrue(answer.startswith(b"HTTP/1.1 405 "), answer[:99])
        # A body is not read.
        answer = self.raw(b"GET / HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\nffff\r\n")
        self.assertTrue(answer.startswith(b"HTTP/1.1 200 "), answer[:99])

    def test_hosts_of_other_sites(self):
        self.start("scenes")
        port = self.port
        for host in (f"127.0.0.1:{port}", f"localhost:{port}", "localhost", f"[::1]:{port}", f"LOCALHOST:{port}"):
            self.assertEqual(self.ask("/", Host=host).status, 200, host)
        for host in ("evil.example", f"evil.example:{port}", f"127.0.0.1.evil.example:{port}", "localhost.evil.example",
                     "127.0.0.1@evil.example", "[::1", "[evil]", "", "127.1", "0x7f.0.0.1", "[::1]evil.example"):
            self.assertEqual(self.ask("/scenes/tiny.stgs", Host=host).status, 421, host)
        close = b"Connection: close\r\n\r\n"
        self.assertIn(b" 400 ", self.raw(b"GET / HTTP/1.1\r\n" + close)[:20])
        twice = b"GET / HTTP/1.1\r\nHost: localhost\r\nHost: evil.example\r\n" + close
        self.assertIn(b" 400 ", self.raw(twice)[:20])

    def test_malformed_and_large_requests(self):
        self.start("scenes")
        for request in (b"GET /" + b"a" * 70000 + b" HTTP/1.1\r\nHost: localhost\r\n\r\n",
                        b"GET / HTTP/1.1\r\nHost: localhost\r\nX: " + b"a" * 70000 + b"\r\n\r\n",
                        b"\0\1\2\3" * 100 + b"\r\n\r\n", b"GET\r\n\r\n", b"GET ?x HTTP/1.1\r\nHost: localhost\r\n\r\n",
                        b"GET x HTTP/1.1\r\nHost: localhost\r\n\r\n", b"\x16\x03\x01\x02\x00\x01\r\n\r\n",
                        b"GET http://evil.example/ HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n"):
            answer = self.raw(request)
            self.assertRegex(answer[:20] or b"HTTP/1.1 400", b"^HTTP/1.[01] (4|5)", request[:40])
        self.assertEqual(self.ask("/").status, 200)

    def test_names_in_the_list(self):
        names = ["<img src=x onerror=alert(1)>.stgs", "a\"b'&.stgs", "line\nfeed.stgs", "ü 100% #?.stgs"]
        for name in names:
            self.write("scenes/" + name, self.bytes)
        with open(os.path.join(os.fsencode(self.path("scenes")), b"\xff.stgs"), "wb") as file:
            file.write(self.bytes)
        self.start("scenes")
        reply = self.ask("/scenes.json")
        self.assertEqual(reply["Content-Type"], "application/json")
        scenes = json.loads(reply.body)["scenes"]
        self.assertLess(set(names), {scene["name"] for scene in scenes})
        self.assertEqual(len(scenes), len(names) + 2)
        for scene in scenes:
            self.assertRegex(scene["href"], r"^scenes/[A-Za-z0-9._~%-]+$")
            self.assertEqual(self.ask("/" + scene["href"]).body, self.bytes)

    def test_a_list_is_limited(self):
        self.start("scenes")

        def listed():
            reply = json.loads(self.ask("/scenes.json").body)
            return len(reply["scenes"]), reply["complete"]

        deep = self.path("scenes", *["d"] * 9)
        os.makedirs(deep)
        for folder in (deep, os.path.dirname(deep)):
            shutil.copy(self.scene, os.path.join(folder, "deep.stgs"))
        self.assertEqual(listed(), (2, True))  # the deepest folder is not searched
        for i in range(998):
            self.write(f"scenes/z{i}.stgs", b"")
        self.assertEqual(listed(), (1000, True))
        self.write("scenes/zz.stgs", b"")
        self.assertEqual(listed(), (1000, False))
        os.mkdir(self.path("many"))
        for i in range(2001):
            os.mkdir(self.path("many", str(i)))
        self.start("many")
        self.assertEqual(listed(), (0, False))

    def test_a_title_is_escaped(self):
        self.succeeds("convert", self.scene, "titled.stgs", "--title", "</title><script>alert(1)</script>&")
        self.start("titled.stgs")
        self.assertIn(b"<title>&lt;/title&gt;&lt;script&gt;alert(1)&lt;/script&gt;&amp;</title>", self.ask("/").body)

    def test_command_lines(self):
        self.fails(IO, "nothere.stgs", "serve", "nothere.stgs")
        self.fails(INVALID, "notes.txt: not an .stgs file", "serve", self.write("notes.txt", "text " * 20))
        self.fails(USAGE, "reads local files only", "serve", "http://here/a.stgs")
        self.fails(USAGE, "cannot read standard input", "serve", "-")
        self.fails(USAGE, "--port: 65536 is out of range", "serve", "scenes", "--port", "65536")
        self.fails(USAGE, "--address here: not an IP address", "serve", "scenes", "--address", "here")
        self.fails(USAGE, "--address 0.0.0.0: not the address of an interface", "serve", "scenes", "--address", "0.0.0.0")
        self.fails(IO, "cannot listen", "serve", "scenes", "--address", "192.0.2.1")
        self.start("scenes")
        self.fails(IO, "cannot listen: Address already in use; use another --port", "serve", "scenes", "--port", self.port)


class NotBuilt(CliTest):
    @unittest.skipIf(built_in("serve"), "serve is built in")
    def test_a_build_without_it_reports_it(self):
        self.fails(NOT_BUILT, "'serve' is not part of this build", "serve", self.fixture("tiny.stgs"))


if __name__ == "__main__":
    unittest.main()
