#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""A program that opens a file as nginx serves it, over a link of a bandwidth and a latency.

usage: stream_over_http.py FILE MBIT_A_SECOND LATENCY_MS PROGRAM [ARGUMENT...]

An argument URL becomes the file's: stream_over_http.py t.stgs 50 40 bench_stream URL. The link is a proxy of this machine: an answer's bytes share the bandwidth over all connections and
come by half the latency later, requests as well, and a new connection carries nothing for the
latency, as its handshake takes. A congestion window that must grow first is not played.
"""
import os
import pathlib
import queue
import socket
import subprocess
import sys
import tempfile
import threading
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "fetch"))
from nginx import Nginx  # noqa: E402

PIECE = 16384
QUEUED = 256  # pieces on their way at most, a direction of a connection


class Bandwidth:
    """When a piece that is sent now has passed, behind all that was sent before."""

    def __init__(self, bytes_a_second):
        self.speed, self.free = bytes_a_second, 0.0
        self.lock = threading.Lock()

    def passed(self, size):
        with self.lock:
            self.free = max(self.free, time.monotonic()) + size / self.speed
            return self.free


def carry(source, sink, latency, bandwidth):
    """All that comes from one socket to the other, later; then its end."""
    on_their_way = queue.Queue(QUEUED)

    def deliver():
        while True:
            due, data = on_their_way.get()
            time.sleep(max(due - time.monotonic(), 0))
            try:
                if not data:
                    sink.shutdown(socket.SHUT_WR)
                    return
                sink.sendall(data)
            except OSError:
                source.close()  # what comes now is for nobody
                while on_their_way.get()[1]:
                    pass
                return

    threading.Thread(target=deliver, daemon=True).start()
    while True:
        try:
            data = source.recv(PIECE)
        except OSError:
            data = b""
        passed = bandwidth.passed(len(data)) if bandwidth else time.monotonic()
        on_their_way.put((passed + latency, data))
        if not data:
            return


def serve(listener, port, latency, bandwidth):
    while True:
        client, _ = listener.accept()
        server = socket.create_connection(("127.0.0.1", port))
        for end in (client, server):
            end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

        def join(client=client, server=server):
            time.sleep(latency)  # the handshake
            threading.Thread(target=carry, args=(server, client, latency / 2, bandwidth),
                             daemon=True).start()
            carry(client, server, latency / 2, None)

        threading.Thread(target=join, daemon=True).start()


def main():
    if len(sys.argv) < 5:
        sys.exit(__doc__)
    file, mbit, latency, *command = sys.argv[1:]
    bandwidth = Bandwidth(float(mbit) * 1e6 / 8)
    with tempfile.TemporaryDirectory() as folder:
        os.symlink(os.path.abspath(file), folder + "/scene.stgs")
        with Nginx(folder) as nginx, socket.create_server(("127.0.0.1", 0)) as listener:
            threading.Thread(target=serve, daemon=True,
                             args=(listener, nginx.port, float(latency) * 1e-3, bandwidth)).start()
            url = f"http://127.0.0.1:{listener.getsockname()[1]}/scene.stgs"
            command = [url if argument == "URL" else argument for argument in command]
            sys.exit(subprocess.run(command, check=False).returncode)


if __name__ == "__main__":
    main()
