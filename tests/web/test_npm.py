#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The commands of the guide install the package without a network and without other packages, and serve
its pages, which show a scene. See package_case.py for the usage; skipped without npm and esbuild.
"""
import json
import os
import re
import shlex
import shutil
import socket
import subprocess
import tempfile
import time
import unittest

from browser import Browser, require
from package_case import HERE, SIZE, run
from page_server import WEBGPU_FLAGS
from test_examples import COLOURS, EXAMPLES, GUIDE

LICENSE = os.path.join(HERE, "..", "..", "LICENSE")
MARK = "<!-- not run: tests/web/test_npm.py runs these commands and shows the page -->"
SHOWN = f"{COLOURS}.then((count) => count > 300)"
# A module of an application. With `node16` and `nodenext`, a module is a file `.mts`.
APPLICATION = """import { createPlayer, type QualityReport } from "stgs";
import { connect } from "stgs/bridge";
const player = createPlayer(document.createElement("canvas"), { quality: "low" });
export const report: QualityReport = player.qualityReport;
export const remote = await connect(document.createElement("iframe"));
// @ts-expect-error: not a quality
player.quality = "best";
"""


def read(*parts):
    with open(os.path.join(*parts), encoding="utf-8") as file:
        return file.read()


def files_of(folder):
    return sorted(os.path.relpath(os.path.join(place, name), folder)
                  for place, _, names in os.walk(folder) for name in names)


class Npm(unittest.TestCase):
    MODULES = {name: name for name in ("three", "playcanvas")}
    make = record = package = npm = ""

    @classmethod
    def setUpClass(cls):
        cls.work = tempfile.mkdtemp(prefix="stgs-npm-")
        cls.addClassCleanup(shutil.rmtree, cls.work, True)
        shutil.copytree(cls.package, os.path.join(cls.work, "stgs", "build", "release", "web", "stgs"))
        subprocess.run([cls.make, os.path.join(cls.work, "scene.stgs"), "3000", "3"], check=True)
        cls.guide = read(GUIDE)
        cls.pages = re.findall(r"```html\n(<!DOCTYPE.*?)```", cls.guide, re.DOTALL)
        cls.map = re.search(r"```html\n(<script type=\"importmap\">.*?)```", cls.guide, re.DOTALL)[1]
        cls.scripts = re.findall(r"```js\n(import .*?)```", cls.guide, re.DOTALL)
        cls.commands = re.findall(re.escape(MARK) + r"\n```sh\n(.*?)```", cls.guide, re.DOTALL)
        assert len(cls.pages) == 4 and len(cls.scripts) == 4 and len(cls.commands) == 3
        cls.folder = os.path.join(cls.work, "page")
        os.mkdir(cls.folder)
        install, serve, bundle = cls.commands
        cls.execute(install)
        cls.installed = os.listdir(os.path.join(cls.folder, "node_modules"))
        cls.execute(bundle)
        for name in cls.MODULES:  # in place of `npm install`, which needs a network
            shutil.copytree(os.path.join(cls.npm, name), os.path.join(cls.folder, "node_modules", name))
        cls.url = cls.serve(serve)
        cls.browsers = [Browser(flags) for flags in ((), WEBGPU_FLAGS)]
        for browser in cls.browsers:
            cls.addClassCleanup(browser.close)

    @classmethod
    def serve(cls, command):
        """Serves the folder by a command, but on a free port. Returns the URL."""
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        examples = os.path.join(cls.work, "stgs", "sdk", "examples", "web")
        os.makedirs(examples)
        with open(os.path.join(examples, "nginx.conf"), "w", encoding="utf-8") as file:
            file.write(read(EXAMPLES, "nginx.conf").replace("127.0.0.1:8000", f"127.0.0.1:{port}"))
        os.chmod(cls.work, 0o755)  # if root runs the test, another user reads the files
        server = cls.enterClassContext(subprocess.Popen(shlex.split(command), cwd=cls.folder))
        cls.addClassCleanup(server.terminate)
        while server.poll() is None:
            try:
                with socket.create_connection(("127.0.0.1", port), 1):
                    return f"http://127.0.0.1:{port}/"
            except ConnectionRefusedError:
                time.sleep(0.05)
        raise RuntimeError("the command of the guide does not serve")

    @classmethod
    def execute(cls, commands):
        """Runs commands in the folder of the page, without a network."""
        settings = {"offline": "true", "audit": "false", "fund": "false", "update_notifier": "false",
                    "cache": os.path.join(cls.work, "cache")}
        environment = {"PATH": os.environ["PATH"], "HOME": cls.work,
                       **{f"npm_config_{key}": value for key, value in settings.items()}}
        result = subprocess.run(["sh", "-e", "-c", commands], cwd=cls.folder, env=environment,
                                capture_output=True, text=True, check=False)
        if result.returncode != 0:
            raise RuntimeError(result.stdout + result.stderr)

    def show(self, page, condition=SHOWN):
        with open(os.path.join(self.folder, "index.html"), "w", encoding="utf-8") as file:
            file.write(page)
        self.open("", condition, self.browsers["WebGPURenderer" in page])

    def open(self, path, condition, browser):
        browser.problems.clear()
        browser.resize(*SIZE)
        browser.open(self.url + path)
        browser.wait_for(condition, 60)
        self.assertEqual(browser.problems, [])

    def test_seven_lines_lead_to_a_page(self):
        self.assertLessEqual((self.commands[0] + self.pages[0]).count("\n"), 7)
        self.assertLessEqual(self.commands[2].count("\n"), 4)

    def test_the_pages_show_a_scene(self):
        for page in self.pages:
            with self.subTest(page):
                self.show(page)
        with self.subTest("site"):
            self.open("site/", SHOWN, self.browsers[0])

    def test_the_scripts_find_the_package(self):
        """The first plays on a canvas. The others use objects of the reader, so only their imports run."""
        page = f"<!DOCTYPE html>{self.map}<canvas></canvas>"
        self.show(f'{page}<script type="module">{self.scripts[0]}</script>')
        for script in self.scripts:
            imports = re.findall(r"^import .*$", script, re.MULTILINE)
            with self.subTest(imports):
                module = "\n".join([*imports, "window.isLoaded = true;"])
                self.show(f'{page}<script type="module">{module}</script>', "window.isLoaded === true")

    def test_the_package_is_complete_and_has_no_dependencies(self):
        installed = os.path.join(self.folder, "node_modules", "stgs")
        self.assertFalse(os.path.islink(installed))
        self.assertEqual(files_of(installed), files_of(self.package))
        self.assertEqual([name for name in self.installed if name[0] != "."], ["stgs"])
        self.assertEqual(read(installed, "LICENSE"), read(LICENSE))
        manifest = json.loads(read(installed, "package.json"))
        for key in "dependencies", "optionalDependencies", "bundleDependencies", "scripts":
            self.assertNotIn(key, manifest)
        for name in manifest["peerDependencies"]:
            self.assertTrue(manifest["peerDependenciesMeta"][name]["optional"])
        self.assertEqual(set(manifest["files"]), {"*.js", "*.js.map", "*.wasm", "types", "README.md", "LICENSE"})
        for target in manifest["exports"].values():
            for path in target.values() if isinstance(target, dict) else [target]:
                self.assertTrue(os.path.exists(os.path.join(installed, path)), path)
        scripts = [name for name in os.listdir(installed) if name.endswith(".js")]
        self.assertEqual(len(scripts), 9)
        for name in scripts:
            self.assertIn(f"sourceMappingURL={name}.map", read(installed, name))
            sources = json.loads(read(installed, name + ".map"))
            self.assertEqual(len(sources["sourcesContent"]), len(sources["sources"]))

    def test_the_types_are_found(self):
        newer = os.path.join(self.npm, "typescript", "bin", "tsc")  # Debian's does not know `bundler`
        with open(os.path.join(self.folder, "types.mts"), "w", encoding="utf-8") as file:
            file.write(APPLICATION)
        for tsc, module, resolution in (("tsc", "node16", "node16"), ("tsc", "nodenext", "nodenext"),
                                        (newer, "nodenext", "nodenext"), (newer, "es2022", "bundler")):
            with self.subTest(tsc=tsc, resolution=resolution):
                if shutil.which(tsc) is None:
                    self.skipTest(f"needs {tsc}")
                checked = subprocess.run(
                    [tsc, "--strict", "--noEmit", "--target", "es2022", "--lib", "es2022,dom",
                     "--module", module, "--moduleResolution", resolution, "types.mts"],
                    cwd=self.folder, capture_output=True, text=True, check=False)
                self.assertEqual((checked.returncode, checked.stdout), (0, ""))


if __name__ == "__main__":
    require("npm", "esbuild")
    run(Npm)
