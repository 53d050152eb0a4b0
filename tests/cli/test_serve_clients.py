# SPDX-License-Identifier: Apache-2.0
"""stgs serve: many clients, slow ones, and signals."""
import contextlib
import http.client
import signal
import socket
import time
import unittest

from harness import built_in
from test_serve import RUNTIME, Server, TIMEOUT

REQUEST_SECONDS = 15  # of client_times.cpp: time for the header of a request


@unittest.skipUnless(built_in("serve"), "serve is not built in")
class Clients(Server):
    def test_signals_end_it_soon(self):
        for number in (signal.SIGINT, signal.SIGTERM):
            with self.subTest(number=number):
                server, _ = self.start("scenes")
                idle = socket.create_connection(("127.0.0.1", self.port), TIMEOUT)
                half = socket.create_connection(("127.0.0.1", self.port), TIMEOUT)
                half.sendall(b"GET /scenes/tiny.stgs HTTP/1.1\r\nHo")
                reading = socket.create_connection(("127.0.0.1", self.port), TIMEOUT)
                reading.sendall(b"GET /stgs-core.wasm HTTP/1.1\r\nHost: localhost\r\n\r\n")
                reading.recv(100)
                begin = time.monotonic()
                server.send_signal(number)
                self.assertEqual(server.wait(TIMEOUT), RUNTIME)
                self.assertLess(time.monotonic() - begin, 2)
                self.assertIn(f"interrupted by {number.name}: scenes: no longer served", server.stderr.read())
                for client in (idle, half, reading):
                    client.close()

    def test_many_connections(self):
        """More clients than the server takes at a time: each gets its answer."""
        self.start("scenes")
        clients = [socket.create_connection(("127.0.0.1", self.port), TIMEOUT) for _ in range(300)]
        for client in clients:
            client.sendall(b"GET /scenes/tiny.stgs HTTP/1.1\r\nHost: localhost\r\nRange: bytes=0-9\r\n"
                           b"Connection: close\r\n\r\n")
        for client in clients:
            answer = b""
            while data := client.recv(65536):
                answer += data
            client.close()
            self.assertTrue(answer.startswith(b"HTTP/1.1 206 ") and answer.endswith(self.bytes[:10]))

    def test_clients_that_never_end_a_request_do_not_keep_others_out(self):
        """They send a byte from time to time, so that their connections are not idle."""
        self.start("scenes")
        clients = [socket.create_connection(("127.0.0.1", self.port), TIMEOUT) for _ in range(128)]
        begin = time.monotonic()
        open_clients = set(clients)
        while open_clients and time.monotonic() - begin < TIMEOUT:
            for client in list(open_clients):
                try:
                    client.sendall(b"G")
                except OSError:
                    open_clients.remove(client)
            time.sleep(0.5)
        for client in clients:
            client.close()
        self.assertEqual(open_clients, set())
        self.assertGreater(time.monotonic() - begin, REQUEST_SECONDS - 2)
        self.assertEqual(self.ask("/").status, 200)

    def test_clients_that_receive_slowly_do_not_keep_others_out(self):
        """They read a little all the time, so that their connections are not idle."""
        with open(self.path("scenes", "large.stgs"), "wb") as file:
            file.truncate(2**30)
        self.start("scenes")
        clients = []
        for i in range(128):
            client = socket.socket()
            client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096 if i < 127 else 65536)
            client.settimeout(TIMEOUT)
            client.connect(("127.0.0.1", self.port))
            client.sendall(b"GET /scenes/large.stgs HTTP/1.1\r\nHost: localhost\r\n\r\n")
            clients.append(client)
            self.addCleanup(client.close)
        fast = clients.pop()  # at 20 times the least rate: keeps its connection
        begin = time.monotonic()
        while clients and time.monotonic() - begin < TIMEOUT:
            time.sleep(0.5)
            self.assertNotEqual(fast.recv(40000), b"")
            for client in list(clients):
                try:
                    if not client.recv(256):
                        clients.remove(client)
                        client.close()
                except ConnectionError:
                    clients.remove(client)
        self.assertEqual(clients, [])
        self.assertNotEqual(fast.recv(100), b"")
        self.assertEqual(self.ask("/").status, 200)

    def test_an_address_has_a_limited_number_of_connections(self):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.connect(("192.0.2.1", 9))  # sends nothing
                address = probe.getsockname()[0]
            except OSError:
                self.skipTest("needs an address that is not of the loopback interface")
        self.start("scenes", "--address", address)
        request = f"GET / HTTP/1.1\r\nHost: {address}\r\n\r\n".encode()
        clients, answered = [], 0
        for _ in range(48):
            client = socket.create_connection((address, self.port), TIMEOUT)
            self.addCleanup(client.close)
            with contextlib.suppress(ConnectionError):
                client.sendall(request)
                answered += client.recv(100).startswith(b"HTTP/1.1 200 ")
            clients.append(client)
        self.assertEqual(answered, 32)
        for client in clients:
            client.close()
        time.sleep(0.2)
        with socket.create_connection((address, self.port), TIMEOUT) as client:
            client.sendall(request)
            self.assertTrue(client.recv(100).startswith(b"HTTP/1.1 200 "))

    def test_a_connection_takes_several_requests(self):
        self.start("scenes")
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=TIMEOUT)
        for i in range(20):
            connection.request("GET", "/scenes/tiny.stgs", headers={"Range": f"bytes={i}-{i + 4}"})
            used = connection.sock
            self.assertEqual(connection.getresponse().read(), self.bytes[i:i + 5])
            self.assertIs(connection.sock, used)
        connection.close()


if __name__ == "__main__":
    unittest.main()
