# SPDX-License-Identifier: Apache-2.0
"""A server of RTSP over TCP (RFC 2326), which relays RTP packets that it receives over UDP."""
import os
import re
import socket
import socketserver
import subprocess
import threading
import time


class Media:
    """A video that ffmpeg sends again and again, at its own pace, as RTP to a local port."""

    def __init__(self, video, fps, sdp_path):
        self.packets = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.packets.bind(("127.0.0.1", 0))
        self.packets.settimeout(0.2)
        self.plays = 0  # how often a client has asked for it
        self.cut_after = None  # packets after which the first connection breaks off
        url = f"rtp://127.0.0.1:{self.packets.getsockname()[1]}?pkt_size=1316"
        self.sender = subprocess.Popen(
            ["ffmpeg", "-v", "error", "-re", "-stream_loop", "-1", "-i", video, "-r", str(fps), "-c:v", "libx264",
             "-preset", "ultrafast", "-tune", "zerolatency", "-g", "5", "-flags", "+global_header", "-threads", "1",
             "-sdp_file", sdp_path, "-f", "rtp", url],
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        deadline = time.monotonic() + 30
        while not os.path.exists(sdp_path) or b"m=video" not in self._read(sdp_path):
            if time.monotonic() > deadline:
                raise RuntimeError("ffmpeg wrote no SDP file")
            time.sleep(0.05)
        self.description = self._read(sdp_path).rstrip() + b"\r\na=control:streamid=0\r\n"

    @staticmethod
    def _read(path):
        with open(path, "rb") as file:
            return file.read()

    def close(self):
        self.sender.kill()
        self.sender.wait()
        self.packets.close()


class Connection(socketserver.StreamRequestHandler):
    def setup(self):
        super().setup()
        self.lock, self.ended = threading.Lock(), threading.Event()

    def handle(self):
        try:
            while first := self.rfile.read(1):
                if first == b"$":  # RTCP from the client
                    size = int.from_bytes(self.rfile.read(3)[1:], "big")
                    self.rfile.read(size)
                    continue
                request = first + self.rfile.readline()
                while (line := self.rfile.readline()).strip():
                    request += line
                self.answer(request.decode())
        except OSError:
            pass  # the connection has ended
        finally:
            self.ended.set()

    def answer(self, request):
        method, url = request.split()[:2]
        found = re.match(r"rtsp://[^/]+/([^/]+)", url)
        media = self.server.media.get(found.group(1)) if found else None
        lines = [re.search(r"CSeq: *\d+", request, re.IGNORECASE).group(0)]
        body = b""
        if method == "OPTIONS":
            lines.append("Public: OPTIONS, DESCRIBE, SETUP, PLAY, TEARDOWN")
        elif media is None:
            self.send(f"RTSP/1.0 404 Not Found\r\n{lines[0]}\r\n\r\n".encode())
            return
        elif method == "DESCRIBE":
            body = media.description
            lines += ["Content-Type: application/sdp", f"Content-Base: {url}/", f"Content-Length: {len(body)}"]
        elif method == "SETUP":
            lines += ["Transport: RTP/AVP/TCP;unicast;interleaved=0-1", "Session: 1"]
        self.send("\r\n".join(["RTSP/1.0 200 OK", *lines, "", ""]).encode() + body)
        if method == "PLAY":
            media.plays += 1
            cut_after = media.cut_after if media.plays == 1 else None
            threading.Thread(target=self.relay, args=(media, cut_after), daemon=True).start()

    def send(self, data):
        with self.lock:
            self.connection.sendall(data)

    def relay(self, media, cut_after):
        sent = 0
        while not self.ended.is_set():
            try:
                packet = media.packets.recv(65536)
                self.send(b"$\0" + len(packet).to_bytes(2, "big") + packet)
            except socket.timeout:
                continue
            except OSError:
                return
            sent += 1
            if sent == cut_after:
                self.connection.shutdown(socket.SHUT_RDWR)


class RtspServer(socketserver.ThreadingTCPServer):
    """Serves Media by name. Use it in a `with` statement."""
    daemon_threads = True

    def __init__(self, media):
        super().__init__(("127.0.0.1", 0), Connection)
        self.media = media
        self.thread = threading.Thread(target=self.serve_forever, daemon=True)
        self.thread.start()

    def url(self, name):
        return f"rtsp://127.0.0.1:{self.server_address[1]}/{name}"

    def __exit__(self, *error):
        self.shutdown()
        super().__exit__(*error)
