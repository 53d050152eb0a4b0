#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Runs a program on a file served by nginx over a link of limited bandwidth and latency.

usage: stream_over_http.py FILE MBIT_PER_SECOND LATENCY_MS PROGRAM [ARGUMENT...]

The argument URL is replaced by the URL of the file, as in

    stream_over_http.py t.stgs 50 40 bench_stream URL

The link is a proxy on this machine. All connections share the bandwidth. Requests and responses are
delayed by half the latency each, and a new connection by the latency of its handshake. The growth
of a congestion window is not simulated.
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

CHUNK_BYTES = 16384
MAX_CHUNKS = 256  # in flight per direction of a connection


class Bandwidth:
    """A link: computes when a chunk that is sent now has passed it, after all earlier ones."""

    def __init__(self, bytes_per_second):
        self.bytes_per_second, self.free_at = bytes_per_second, 0.0
        self.lock = threading.Lock()

    def transfer_end(self, size):
        with self.lock:
            self.free_at = max(self.free_at, time.monotonic()) + size / self.bytes_per_second
            return self.free_at


def forward(source, sink, latency, bandwidth):
    """Forwards one socket to another after the latency, including the end of the stream."""
    in_flight = queue.Queue(MAX_CHUNKS)

    def deliver():
        while True:
            due, data = in_flight.get()
            time.sleep(max(due - time.monotonic(), 0))
            try:
                if not data:
                    sink.shutdown(socket.SHUT_WR)
                    return
                sink.sendall(data)
            except OSError:
                source.close()  # drop the remaining chunks
                while in_flight.get()[1]:
                    pass
                return

    threading.Thread(target=deliver, daemon=True).start()
    while True:
        try:
            data = source.recv(CHUNK_BYTES)
        except OSError:
            data = b""
        arrival = bandwidth.transfer_end(len(data)) if bandwidth else time.monotonic()
        in_flight.put((arrival + latency, data))
        if not data:
            return


def serve(listener, port, latency, bandwidth):
    while True:
        client, _ = listener.accept()
        server = socket.create_connection(("127.0.0.1", port))
        for end in (client, server):
            end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

        def connect(client=client, server=server):
            time.sleep(latency)  # the handshake
            threading.Thread(target=forward, args=(server, client, latency / 2, bandwidth),
                             daemon=True).start()
            forward(client, server, latency / 2, None)

        threading.Thread(target=connect, daemon=True).start()


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
