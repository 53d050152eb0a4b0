# SPDX-License-Identifier: Apache-2.0
"""A Firefox that a test drives by its protocol Marionette."""
import json
import os
import shutil
import socket
import subprocess
import tempfile
import time

from browser_page import BrowserPage

FIREFOX = shutil.which("firefox-esr") or shutil.which("firefox")
STARTUP_TIMEOUT = 120  # seconds
TIMEOUT = 60  # seconds of a command
PREFERENCES = {"marionette.port": 0, "webgl.force-enabled": True,
               "browser.shell.checkDefaultBrowser": False, "app.update.enabled": False,
               "datareporting.policy.dataSubmissionEnabled": False}
# Evaluates an expression in the page and waits for its promise.
EVALUATE = """const done = arguments[arguments.length - 1];
Promise.resolve().then(() => window.eval(arguments[0])).then(
  (value) => done(JSON.stringify([true, value ?? null])),
  (error) => done(JSON.stringify([false, String(error)])));"""


class Firefox(BrowserPage):
    """One page, with methods of `browser.Browser`. Headless, Firefox has no WebGL without a GPU, so
    it needs a display: `environment` is that of its process.
    """

    def __init__(self, environment):
        self.profile = tempfile.TemporaryDirectory(prefix="stgs-firefox-", ignore_cleanup_errors=True)
        with open(os.path.join(self.profile.name, "user.js"), "w", encoding="ascii") as file:
            for name, value in PREFERENCES.items():
                file.write(f"user_pref({json.dumps(name)}, {json.dumps(value)});\n")
        self.process = subprocess.Popen(
            [FIREFOX, "--no-remote", "--marionette", "--profile", self.profile.name],
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            env={**environment, "HOME": self.profile.name}, start_new_session=True)
        try:
            self.connect()
        except BaseException:
            self.close()
            raise

    def connect(self):
        path = os.path.join(self.profile.name, "MarionetteActivePort")
        end = time.monotonic() + STARTUP_TIMEOUT
        while not os.path.exists(path) or os.path.getsize(path) == 0:
            if time.monotonic() > end or self.process.poll() is not None:
                raise TimeoutError("Firefox did not start")
            time.sleep(0.1)
        with open(path, encoding="ascii") as file:
            port = int(file.read())
        self.socket = socket.create_connection(("127.0.0.1", port), TIMEOUT)
        self.buffer = b""
        self.next_id = 0
        self.receive()  # the greeting
        self.send("WebDriver:NewSession")
        self.send("WebDriver:SetTimeouts", script=1000 * TIMEOUT)

    def send(self, command, **parameters):
        message = json.dumps([0, self.next_id, command, parameters]).encode()
        self.next_id += 1
        self.socket.sendall(b"%d:%s" % (len(message), message))
        _, _, error, result = self.receive()
        if error:
            raise RuntimeError(f"{command}: {error['message']}")
        return result

    def receive(self):
        while b":" not in self.buffer:
            self.read()
        length, _, self.buffer = self.buffer.partition(b":")
        while len(self.buffer) < int(length):
            self.read()
        message, self.buffer = self.buffer[:int(length)], self.buffer[int(length):]
        return json.loads(message)

    def read(self):
        data = self.socket.recv(1 << 20)
        if not data:
            raise RuntimeError("Firefox ended")
        self.buffer += data

    def open(self, url):
        self.send("WebDriver:Navigate", url=url)

    def evaluate(self, script):
        reply = self.send("WebDriver:ExecuteAsyncScript", script=EVALUATE, args=[script])
        is_value, value = json.loads(reply["value"])
        if not is_value:
            raise RuntimeError(value)
        return value

    def screenshot_data(self):
        return self.send("WebDriver:TakeScreenshot", full=False)["value"]

    def close(self):
        super().close()
        self.profile.cleanup()
