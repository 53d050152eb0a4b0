# SPDX-License-Identifier: Apache-2.0
"""A TCP link to a server of this machine that misbehaves as it is told, connection by connection."""
import select
import socket
import struct
import threading
import time


class FaultyLink:
    """Carries connections to `port`. `faults`: for each connection in turn a dict, then none.

    delay: seconds by which each piece of an answer comes later; cut: bytes of the answers after
    which the connection is reset; stall: the same, and silence.
    """

    PIECE = 16384

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
            threading.Thread(target=self._carry, args=(client, fault), daemon=True).start()

    def _carry(self, client, fault):
        """One thread both ways: a socket that another one waits for is not reset when it is closed."""
        left = fault.get("cut", fault.get("stall", float("inf")))
        try:
            with socket.create_connection(("127.0.0.1", self.port)) as server:
                while left > 0:
                    for ready in select.select([client, server], [], [])[0]:
                        most = self.PIECE if ready is client else int(min(self.PIECE, left))
                        data = ready.recv(most)
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
            pass  # either has gone
        finally:
            client.close()
