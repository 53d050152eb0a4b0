# SPDX-License-Identifier: Apache-2.0
"""nginx on a free port of this machine, serving a folder."""
import os
import socket
import subprocess
import time


class Nginx:
    """`limit`: bytes a second of a connection, as nginx writes them."""

    def __init__(self, folder, limit="0"):
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.url = f"http://127.0.0.1:{self.port}/scene.stgs"
        config = f"""
            worker_processes 1; daemon off; pid {folder}/pid; error_log {folder}/error.log;
            events {{}}
            http {{ access_log off; client_body_temp_path {folder}/1; proxy_temp_path {folder}/2;
              fastcgi_temp_path {folder}/3; uwsgi_temp_path {folder}/4;
              scgi_temp_path {folder}/5;
              server {{ listen 127.0.0.1:{self.port}; root {folder}; limit_rate {limit}; }} }}"""
        with open(folder + "/nginx.conf", "w", encoding="ascii") as file:
            file.write(config if os.getuid() else "user root;" + config)
        self.command = ["nginx", "-e", folder + "/error.log", "-c", folder + "/nginx.conf"]

    def __enter__(self):
        self.server = subprocess.Popen(self.command, stderr=subprocess.DEVNULL)
        for _ in range(100):
            with socket.socket() as client:
                if client.connect_ex(("127.0.0.1", self.port)) == 0:
                    break
            time.sleep(0.05)
        return self

    def __exit__(self, *_):
        self.server.terminate()
        self.server.wait()
