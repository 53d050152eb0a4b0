# SPDX-License-Identifier: Apache-2.0
"""An HTTP server of one file that injects faults, request by request."""
import http.server
import re
import socket
import struct
import threading
import time


class FaultyServer:
    """Serves `data` at any path. Each request takes the next item of `faults`, a dict or a function
    of the server that returns one; later requests have no faults.

    status:      respond with this status and no file
    retry_after: with `status`: send this header
    slowly:      with `status`: seconds between the five bytes of the body
    cut:         bytes of the body after which the connection is reset
    stall:       as cut, but the reset comes after 20 s of silence
    delay:       seconds before the response
    drip:        seconds between the bytes of the body
    complete:    ignore the range
    shift:       bytes by which the range in the response begins later
    encode:      state the content encoding gzip
    long:        number of additional bytes
    anonymous:   send no ETag
    redirect:    redirect to this URL
    no_total:    omit the total size
    do:          call this function with the server before responding
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
                pass  # clients close connections

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
    def plain(request, status, headers, pause=0):
        request.send_response(status)
        for name, value in headers.items():
            request.send_header(name, str(value))
        request.send_header("Content-Length", "5")
        request.end_headers()
        for k in range(5):
            request.wfile.write(b"sorry"[k:k + 1])
            request.wfile.flush()
            time.sleep(pause)

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
        if fault.get("complete"):
            request.send_response(200)
            body = data
        else:
            request.send_response(206)
            begin = first + fault.get("shift", 0)
            total = "*" if fault.get("no_total") else len(data)
            request.send_header("Content-Range", f"bytes {begin}-{begin + len(body) - 1}/{total}")
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
        sent = fault.get("cut", fault.get("stall"))
        if sent is None:
            request.wfile.write(body)
            return
        request.wfile.write(body[:sent])
        request.wfile.flush()
        if "stall" in fault:
            time.sleep(20)
        # A reset, because a client may take a normal close for the end of the body.
        request.connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER,
                                      struct.pack("ii", 1, 0))
        request.connection.close()
        request.close_connection = True
