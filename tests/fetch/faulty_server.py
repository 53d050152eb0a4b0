# SPDX-License-Identifier: Apache-2.0
"""An HTTP server of one file that misbehaves as it is told, request by request."""
import http.server
import re
import socket
import struct
import threading
import time


class FaultyServer:
    """Serves `data` at any path. `faults`: for each request in turn a dict, or what gives one for the
    server, then none.

    status: answer with this and no file (retry_after: with that header; slowly: five bytes so many
    seconds apart); cut: bytes of the body after which the connection is reset; stall: the same, and
    silence; delay: seconds before the answer; drip: a byte each so many seconds; whole: ignore the
    range; shift: answer another range; encode: say that it is gzip; long: bytes too many;
    anonymous: no ETag and no time; redirect: another place; no_total.
    """

    def __init__(self, data, faults=()):
        self.data = data
        self.etag = '"1"'
        self.faults = list(faults)
        self.ranges = []
        self.connections = set()
        self.lock = threading.Lock()
        outer = self

        class Handler(http.server.BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def log_message(self, *_):
                pass

            def do_GET(self):
                outer.answer(self)

        class Server(http.server.ThreadingHTTPServer):
            daemon_threads = True

            def handle_error(self, *_):
                pass  # clients go away

        self.server = Server(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self.server.server_address[1]}/scene.stgs"
        threading.Thread(target=self.server.serve_forever, daemon=True).start()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.server.shutdown()
        self.server.server_close()

    def answer(self, request):
        with self.lock:
            fault = self.faults.pop(0) if self.faults else {}
            fault = fault(self) if callable(fault) else fault
            data, etag = self.data, self.etag
            self.ranges.append(request.headers.get("Range"))
            self.connections.add(request.client_address)
        if "do" in fault:
            fault["do"](self)
            data, etag = self.data, self.etag
        time.sleep(fault.get("delay", 0))
        if "redirect" in fault:
            self.plain(request, 302, {"Location": fault["redirect"]})
        elif "status" in fault:
            after = {"Retry-After": fault["retry_after"]} if "retry_after" in fault else {}
            self.plain(request, fault["status"], after, fault.get("slowly", 0))
        else:
            self.file(request, fault, data, etag)

    @staticmethod
    def plain(request, status, headers, between=0):
        request.send_response(status)
        for name, value in headers.items():
            request.send_header(name, str(value))
        request.send_header("Content-Length", "5")
        request.end_headers()
        for k in range(5):
            request.wfile.write(b"sorry"[k:k + 1])
            request.wfile.flush()
            time.sleep(between)

    @staticmethod
    def file(request, fault, data, etag):
        first, last = map(int, re.match(r"bytes=(\d+)-(\d+)$", request.headers["Range"]).groups())
        if first >= len(data):
            request.send_response(416)
            request.send_header("Content-Range", f"bytes */{len(data)}")
            request.send_header("Content-Length", "0")
            request.end_headers()
            return
        last = min(last, len(data) - 1)
        body = data[first:last + 1]
        if request.headers.get("If-None-Match") == etag:
            request.send_response(304)
            request.send_header("ETag", etag)
            request.end_headers()
            return
        if fault.get("whole"):
            request.send_response(200)
            body = data
        else:
            request.send_response(206)
            shown = first + fault.get("shift", 0)
            total = "*" if fault.get("no_total") else len(data)
            request.send_header("Content-Range", f"bytes {shown}-{shown + len(body) - 1}/{total}")
        if not fault.get("anonymous"):
            request.send_header("ETag", etag)
        if fault.get("encode"):
            request.send_header("Content-Encoding", "gzip")
        body += b"!" * fault.get("long", 0)
        request.send_header("Content-Length", str(len(body)))
        request.end_headers()
        if "drip" in fault:
            for k in range(len(body)):
                request.wfile.write(body[k:k + 1])
                request.wfile.flush()
                time.sleep(fault["drip"])
            return
        part = fault.get("cut", fault.get("stall"))
        if part is None:
            request.wfile.write(body)
            return
        request.wfile.write(body[:part])
        request.wfile.flush()
        if "stall" in fault:
            time.sleep(20)
        # A reset, and not the end that a peer may take for the body's.
        request.connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER,
                                      struct.pack("ii", 1, 0))
        request.connection.close()
        request.close_connection = True
