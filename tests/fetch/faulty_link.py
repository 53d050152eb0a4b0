# SPDX-License-Identifier: Apache-2.0
"""A TCP proxy to a local server that injects faults, connection by connection."""
import select
import socket
import struct
import threading
import time


class FaultyLink:
    """Forwards connections to `port`. Each connection takes the next dict of `faults`; later ones
    have no faults.

    delay: seconds added before each chunk of a response
    cut:   bytes of the responses after which the connection is reset
    stall: as cut, but the reset comes after silence until the test ends
    do:    a function that is called after these bytes
    """

    CHUNK = 16384

    def __init__(self, port, faults=()):
        self.port = port
        self.faults = list(faults)
        self.connections = 0
        self.ended = threading.Event()
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.url = f"http://127.0.0.1:{self.listener.getsockname()[1]}/scene.stgs"

    def __enter__(self):
        threading.Thread(target=self._accept, daemon=True).start()
        return self

    def __exit__(self, *_):
        self.ended.set()
        self.listener.close()

    def _accept(self):
        while True:
            try:
                client, _ = self.listener.accept()
            except OSError:
                return  # closed
            self.connections += 1
            fault = self.faults.pop(0) if self.faults else {}
            threading.Thread(target=self._forward, args=(client, fault), daemon=True).start()

    def _forward(self, client, fault):
        """Forwards both directions in one thread: closing a socket does not reset it while another
        thread waits for it."""
        left = fault.get("cut", fault.get("stall", float("inf")))
        try:
            with socket.create_connection(("127.0.0.1", self.port)) as server:
                while left > 0:
                    for ready in select.select([client, server], [], [])[0]:
                        size = self.CHUNK if ready is client else int(min(self.CHUNK, left))
                        data = ready.recv(size)
                        if not data:
                            return
                        if ready is client:
                            server.sendall(data)
                            continue
                        left -= len(data)
                        time.sleep(fault.get("delay", 0))
                        client.sendall(data)
                        if left <= 0:
                            break
            if "do" in fault:
                fault["do"]()
            if "stall" in fault:
                self.ended.wait()
            client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        except OSError:
            pass  # a peer closed its connection
        finally:
            client.close()
