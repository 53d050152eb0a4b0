#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The links of all pages resolve, in the source tree and in the documentation site, which is built
without a warning and reaches every page, every declaration of the public headers and every name of the
package for browsers.

usage: test_site.py SOURCE CMAKE    CMAKE is empty if Doxygen is not installed
"""
import glob
import html.parser
import os
import re
import shutil
import subprocess
import sys
import tempfile
import unittest
import urllib.parse

SOURCE, CMAKE = sys.argv[1:3]
sys.path.append(os.path.join(SOURCE, "sdk/docs/site"))
import page as site_page  # noqa: E402

BLOCK = re.compile(r"^```.*?^```$|^    .*?$", re.DOTALL | re.MULTILINE)
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")
# Pages of the repository, other than those below.
FOLDERS = "", "spec", "spec/*", "sdk/docs", "sdk/docs/*", "tests/*", "tests/data/*", ".github", ".github/*"


def read(*parts):
    with open(os.path.join(*parts), encoding="utf-8") as file:
        return file.read()


def anchors_of(text):
    headings = re.findall(r"^#{1,6} (.*?)\s*$", BLOCK.sub("", text), re.MULTILINE)
    return {site_page.slug(title) for title in headings}


class Source(unittest.TestCase):
    def test_links_of_pages_resolve(self):
        pages = [path for folder in FOLDERS
                 for path in glob.glob(os.path.join(SOURCE, folder, "*.md"))]
        self.assertGreater(len(pages), 30)
        checked = 0
        for path in pages:
            prose = re.sub(r"`[^`\n]+`", "", BLOCK.sub("", read(path)))
            for target in LINK.findall(prose):
                if re.match(r"[a-z]+:", target):
                    continue
                checked += 1
                file, _, anchor = target.partition("#")
                linked = os.path.normpath(os.path.join(os.path.dirname(path), file)) if file else path
                self.assertTrue(os.path.exists(linked), f"{path} links to {target}")
                if anchor:
                    self.assertIn(anchor, anchors_of(read(linked)), f"{path} links to {target}")
        self.assertGreater(checked, 50)


class Page(html.parser.HTMLParser):
    """The links and the anchors of a page."""

    def __init__(self, text):
        super().__init__()
        self.links, self.anchors = [], set()
        # Without Doxygen's line of links to the sections, which the site does not show.
        self.feed(re.sub(r'<div class="summary">.*?</div>', "", text, flags=re.DOTALL))

    def handle_starttag(self, tag, attrs):
        for name, value in attrs:
            if name in ("href", "src") and value:
                self.links.append(value)
            if name in ("id", "name") and value:
                self.anchors.add(value)


PROJECT = f"""cmake_minimum_required(VERSION 3.25)
project(stgs VERSION 1.0.0 LANGUAGES NONE)
set(PROJECT_SOURCE_DIR "{SOURCE}")
add_subdirectory("{SOURCE}/sdk/docs" docs)
"""
CAN_MAKE_REFERENCE = shutil.which("node") and shutil.which("tsc")


def build(case, target, *options):
    """Builds a target of sdk/docs alone. Returns the build folder of sdk/docs and the result."""
    folder = tempfile.mkdtemp()
    case.addClassCleanup(shutil.rmtree, folder)
    with open(os.path.join(folder, "CMakeLists.txt"), "w", encoding="utf-8") as file:
        file.write(PROJECT)
    subprocess.run([CMAKE, "-G", "Ninja", "-S", folder, "-B", folder, *options], capture_output=True, check=True)
    built = subprocess.run([CMAKE, "--build", folder, "--target", target], capture_output=True, text=True, check=False)
    return os.path.join(folder, "docs"), built


@unittest.skipUnless(CMAKE, "needs Doxygen")
class Site(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        output, cls.built = build(cls, "docs")
        cls.folder = os.path.join(output, "html")
        # Doxygen's lists of all members are not installed, so no page may link to them.
        for path in glob.glob(os.path.join(cls.folder, "*-members.html")):
            os.remove(path)
        cls.pages = {os.path.basename(path): read(path)
                     for path in glob.glob(os.path.join(cls.folder, "*.html"))}
        cls.parsed = {name: Page(text) for name, text in cls.pages.items()}

    def test_it_is_built_without_a_warning(self):
        self.assertEqual((self.built.returncode, self.built.stderr), (0, ""))
        progress = re.compile(r"^\[\d+/\d+\] ")
        self.assertEqual([line for line in self.built.stdout.splitlines() if not progress.match(line)], [])

    @unittest.skipUnless(CAN_MAKE_REFERENCE, "needs node and tsc")
    def test_it_contains_the_reference_of_the_package(self):
        self.assertIn("js-ScenePlayer-currentTime", self.parsed["library_javascript.html"].anchors)

    def test_it_states_that_the_reference_is_missing(self):
        output, built = build(type(self), "docs/javascript.html", "-DSTGS_TSC=OFF")
        self.assertEqual(built.returncode, 0)
        self.assertIn("built without <code>node</code> and <code>tsc</code>", read(output, "javascript.html"))

    @unittest.skipUnless(CAN_MAKE_REFERENCE, "needs node and tsc")
    def test_it_is_not_built_if_the_reference_fails(self):
        with tempfile.NamedTemporaryFile() as shim:
            output, built = build(type(self), "docs", f"-DSTGS_TSC={shim.name}")
        self.assertNotEqual(built.returncode, 0)
        self.assertIn(f"javascript.mjs: {shim.name} is not in a package of TypeScript", built.stdout)
        self.assertFalse(os.path.exists(os.path.join(output, "html", "index.html")))

    def test_links_resolve(self):
        self.assertGreater(len(self.pages), 80)
        for name, parsed in self.parsed.items():
            for link in parsed.links:
                url = urllib.parse.urlparse(link)
                if url.scheme:
                    continue
                target = urllib.parse.unquote(url.path) or name
                self.assertTrue(os.path.exists(os.path.join(self.folder, target)),
                                f"{name} links to {link}")
                if url.fragment and target.endswith(".html"):
                    self.assertIn(urllib.parse.unquote(url.fragment), self.parsed[target].anchors,
                                  f"{name} links to {link}")

    def test_the_contents_list_every_page(self):
        listed = set(Page(read(SOURCE, "sdk/docs/site/header.html")).links)
        pages = [os.path.relpath(path, SOURCE) for path in
                 glob.glob(os.path.join(SOURCE, "**/*.md"), recursive=True)]
        labels = {site_page.label_of(path) for path in pages if site_page.is_page(path)}
        self.assertGreater(len(labels), 25)
        for label in labels:
            self.assertIn(label + ".html", self.pages)
            self.assertIn(f"$relpath^{label}.html", listed)

    def test_every_declaration_is_described(self):
        shown = {name: re.sub(r"<[^>]+>", " ", text) for name, text in self.pages.items()
                 if name.startswith(("group__", "struct", "class"))}
        every = "\n".join(shown.values())
        names = set()
        for path in glob.glob(os.path.join(SOURCE, "sdk/include/stgs/*.h")):
            names |= set(re.findall(r"\b(stgs_\w+)\(", read(path)))
            names |= set(re.findall(r"^(?:#define |  )(STGS_[A-Z0-9_]+) ", read(path), re.MULTILINE))
        names -= {"STGS_API"}
        self.assertGreater(len(names), 150)
        self.assertEqual([name for name in sorted(names) if not re.search(rf"\b{name}\b", every)], [])
        for name in "Scene", "Renderer", "Player", "Encoder", "Recorder", "Error":
            self.assertIn(f"classstgs_1_1hpp_1_1{name}.html", shown)
        self.assertIn("start_view", shown["classstgs_1_1hpp_1_1Scene.html"])


@unittest.skipUnless(CAN_MAKE_REFERENCE, "needs node and tsc")
class JavaScript(unittest.TestCase):
    """The reference of the package for browsers, which the site contains."""

    @staticmethod
    def make(*folder):
        return subprocess.run(["node", os.path.join(SOURCE, "sdk/docs/site/javascript.mjs"), shutil.which("tsc"), *folder],
                              capture_output=True, text=True, check=False)

    def test_every_exported_name_is_described(self):
        made = self.make()
        self.assertEqual((made.returncode, made.stderr), (0, ""))
        page, names = Page(made.stdout), {"StgsPlayerElement"}
        for module in "index", "stgs-bridge", "three/index", "playcanvas/index", "webgpu/index", "webgl2/index":
            text = read(SOURCE, f"sdk/web/src/{module}.ts")
            for listed in re.findall(r"^export (?:type )?\{([^}]*)\}", text, re.MULTILINE):
                names |= set(re.findall(r"\w+", listed))
            names |= set(re.findall(r"^export (?:function|interface|class|type) (\w+)", text, re.MULTILINE))
        self.assertGreater(len(names), 50)
        self.assertEqual([name for name in sorted(names) if f"js-{name}" not in page.anchors], [])
        self.assertEqual([link for link in page.links if link[1:] not in page.anchors], [])
        self.assertIn("js-ScenePlayer-currentTime", page.anchors)

    def test_missing_comments_and_members_are_reported(self):
        with tempfile.TemporaryDirectory() as folder:
            with open(os.path.join(folder, "index.ts"), "w", encoding="utf-8") as file:
                file.write("/** See `Box.size`, `Box.none` and `Other.none`. */\nexport function open(): Box { return { size: 1 }; }\n"
                           "export interface Box { size: number; }\n")
            made = self.make(folder)
            output = os.path.join(folder, "page.html")
            self.assertEqual(self.make(folder, output).returncode, 1)
            self.assertFalse(os.path.exists(output))
        self.assertEqual(made.returncode, 1)
        self.assertEqual(made.stderr, "javascript.mjs: Box has no comment\njavascript.mjs: the comment of open refers to"
                                      " Box.none, which is not in the reference\n")
        self.assertIn('<a href="#js-Box-size"><code>Box.size</code></a>', made.stdout)


if __name__ == "__main__":
    unittest.main(argv=["test_site.py", *sys.argv[3:]])
