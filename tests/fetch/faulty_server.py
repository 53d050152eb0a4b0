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
    of the server that returns one; later requests have no faults. `headers`: of all responses.

    status:      respond with this status and no file
    retry_after: with `status`: send this header
    slowly:      with `status`: seconds between the five bytes of the body
    cut:         bytes of the body after which the connection is reset
    stall:       as cut, but the reset comes after 20 s of silence
    delay:       seconds before the response
    drip:        seconds between the bytes of the body; or between pieces of `piece` bytes
    complete:    ignore the range
    shift:       bytes by which the range in the response begins later
    encode:      state the content encoding gzip
    long:        number of additional bytes
    anonymous:   send no ETag
    redirect:    redirect to this URL
    no_total:    omit the total size
    header_drip: seconds between the lines of headers without an end
    interim:     seconds between responses 100 without an end
    huge_header: bytes of the headers, in lines of `line` bytes (default: one line)
    endless:     a response of this status, whose body has no end
    do:          call this function with the server before responding
    """

    def __init__(self, data, faults=(), headers=()):
        self.data = data
        self.etag = '"1"'
        self.faults = list(faults)
        self.ranges = []
        self.authorizations = []
        self.proxy_authorizations = []
        self.connections = set()
        self.lock = threading.Lock()
        outer = self

        class Handler(http.server.BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"
            disable_nagle_algorithm = True

            def log_message(self, *_):
                pass

            def do_GET(self):
                outer.answer(self)

            def end_headers(self):
                for header in headers:
                    self.send_header(*header)
                super().end_headers()

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
            self.authorizations.append(request.headers.get("Authorization"))
            self.proxy_authorizations.append(request.headers.get("Proxy-Authorization"))
            self.connections.add(request.client_address)
        if "do" in fault:
            fault["do"](self)
            data, etag = self.data, self.etag
        time.sleep(fault.get("delay", 0))
        if {"header_drip", "interim", "huge_header", "endless"} & fault.keys():
            self.misbehave(request, fault, len(data))
        elif "redirect" in fault:
            self.plain(request, 302, {"Location": fault["redirect"]})
        elif "status" in fault:
            after = {"Retry-After": fault["retry_after"]} if "retry_after" in fault else {}
            self.plain(request, fault["status"], after, fault.get("slowly", 0))
        else:
            self.file(request, fault, data, etag)

    @staticmethod
    def misbehave(request, fault, size):
        """Sends a response that has no end, or a far one, until the client disconnects."""
        begin = int(re.match(r"bytes=(\d+)-", request.headers["Range"]).group(1))
        def send(data, pause=0.0):
            request.wfile.write(data)
            request.wfile.flush()
            time.sleep(pause)

        status = fault.get("endless", 206)
        head = (b"HTTP/1.1 %d Status\r\nETag: \"1\"\r\nContent-Range: bytes %d-%d/%d\r\n"
                % (status, begin, size - 1, size))
        while "interim" in fault:
            send(b"HTTP/1.1 100 Continue\r\n\r\n", fault["interim"])
        send(head)
        while "header_drip" in fault:
            send(b"X-More: 1\r\n", fault["header_drip"])
        if "huge_header" in fault:
            line = fault.get("line", fault["huge_header"])
            send((b"X-Huge: " + b"x" * line + b"\r\n") * (fault["huge_header"] // line))
        send(b"Transfer-Encoding: chunked\r\n\r\n")
        while "endless" in fault:
            send(b"4000\r\n" + bytes(0x4000) + b"\r\n")

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
            piece = fault.get("piece", 1)
            for k in range(0, fault.get("cut", len(body)), piece):
                request.wfile.write(body[k:k + piece])
                request.wfile.flush()
                time.sleep(fault["drip"])
            if "cut" not in fault:
                return
            body = b""
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
