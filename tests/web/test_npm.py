#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The commands of the guide install the package without a network and without other packages, and the
pages that they make show a scene. See package_case.py for the usage; skipped without npm and esbuild.
"""
import json
import os
import re
import shutil
import subprocess
import tempfile
import unittest

from browser import require
from package_case import HERE, SIZE, run, serve
from test_examples import COLOURS, GUIDE

LICENSE = os.path.join(HERE, "..", "..", "LICENSE")
MARK = "<!-- not run: tests/web/test_npm.py runs these commands and shows the page -->"
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
    MODULES = {}
    make = record = package = npm = ""

    @classmethod
    def setUpClass(cls):
        cls.work = tempfile.mkdtemp(prefix="stgs-npm-")
        cls.addClassCleanup(shutil.rmtree, cls.work, True)
        shutil.copytree(cls.package, os.path.join(cls.work, "stgs", "build", "release", "web", "stgs"))
        guide = read(GUIDE)
        cls.pages = re.findall(r"```html\n(<!DOCTYPE[^`]*node_modules.*?)```", guide, re.DOTALL)
        cls.commands = re.findall(re.escape(MARK) + r"\n```sh\n(.*?)```", guide, re.DOTALL)
        assert len(cls.pages) == 1 and len(cls.commands) == 2
        cls.page, cls.application = (cls.execute(name, commands)
                                     for name, commands in zip(("page", "application"), cls.commands))
        with open(os.path.join(cls.page, "index.html"), "w", encoding="utf-8") as file:
            file.write(cls.pages[0])
        for folder in cls.page, os.path.join(cls.application, "site"):
            subprocess.run([cls.make, os.path.join(folder, "scene.stgs"), "3000", "3"], check=True)
        cls.url, cls.browser = serve(cls, cls.work)

    @classmethod
    def execute(cls, name, commands):
        """Runs commands in a new folder, without a network. Returns the folder."""
        folder = os.path.join(cls.work, name)
        os.mkdir(folder)
        settings = {"offline": "true", "audit": "false", "fund": "false", "update_notifier": "false",
                    "cache": os.path.join(cls.work, "cache")}
        environment = {"PATH": os.environ["PATH"], "HOME": cls.work,
                       **{f"npm_config_{key}": value for key, value in settings.items()}}
        result = subprocess.run(["sh", "-e", "-c", commands], cwd=folder, env=environment,
                                capture_output=True, text=True, check=False)
        if result.returncode != 0:
            raise RuntimeError(result.stdout + result.stderr)
        return folder

    def test_five_lines_lead_to_a_page(self):
        self.assertLessEqual((self.commands[0] + self.pages[0]).count("\n"), 5)
        self.assertLessEqual(self.commands[1].count("\n"), 5)

    def test_the_pages_show_a_scene(self):
        for page in "page/index.html", "application/site/index.html":
            with self.subTest(page):
                self.browser.problems.clear()
                self.browser.resize(*SIZE)
                self.browser.open(self.url + page)
                self.browser.wait_for(f"{COLOURS}.then((count) => count > 300)", 60)
                self.assertEqual(self.browser.problems, [])

    def test_the_package_is_complete_and_has_no_dependencies(self):
        installed = os.path.join(self.page, "node_modules", "stgs")
        self.assertFalse(os.path.islink(installed))
        self.assertEqual(files_of(installed), files_of(self.package))
        self.assertEqual([name for name in os.listdir(os.path.dirname(installed)) if name[0] != "."], ["stgs"])
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
        with open(os.path.join(self.application, "types.mts"), "w", encoding="utf-8") as file:
            file.write(APPLICATION)
        for tsc, module, resolution in (("tsc", "node16", "node16"), ("tsc", "nodenext", "nodenext"),
                                        (newer, "nodenext", "nodenext"), (newer, "es2022", "bundler")):
            with self.subTest(tsc=tsc, resolution=resolution):
                if shutil.which(tsc) is None:
                    self.skipTest(f"needs {tsc}")
                checked = subprocess.run(
                    [tsc, "--strict", "--noEmit", "--target", "es2022", "--lib", "es2022,dom",
                     "--module", module, "--moduleResolution", resolution, "types.mts"],
                    cwd=self.application, capture_output=True, text=True, check=False)
                self.assertEqual((checked.returncode, checked.stdout), (0, ""))


if __name__ == "__main__":
    require("npm", "esbuild")
    run(Npm)
