# SPDX-License-Identifier: Apache-2.0
"""The manual pages contain the program's help."""
import functools
import gzip
import os
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

import harness
from harness import CliTest


@functools.cache
def help_of(*verb):
    return subprocess.run([harness.STGS, *verb, "--help"], capture_output=True, text=True,
                          check=True).stdout


def verbs():
    listed = re.search(r"^Subcommands:\n(.*?)\n\n", help_of(), re.DOTALL | re.MULTILINE).group(1)
    return re.findall(r"^  ([a-z]+) ", listed, re.MULTILINE)


def options(text):
    """Returns the options that a help text declares, without those that it only mentions."""
    heads = re.findall(r"^  (-\S+)", text, re.MULTILINE)
    return {name for head in heads for name in head.split(",")}


def plain(text):
    """Returns the text of a page without its roff requests and escapes."""
    text = re.sub(r"\\f[A-Z]|\\&", "", text).replace("\\-", "-").replace("\\e", "\\")
    return re.sub(r"^\.[A-Z]+ ?", "", text, flags=re.MULTILINE)


class Manual(CliTest):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.mkdtemp(prefix="stgs-manual-")
        cls.addClassCleanup(shutil.rmtree, cls.folder)
        subprocess.run([sys.executable, os.path.join(harness.SOURCE, "tools/man/make_man.py"),
                        harness.STGS, cls.folder], check=True)

    def page(self, *verb):
        with gzip.open(os.path.join(self.folder, "-".join(["stgs", *verb]) + ".1.gz"), "rt") as file:
            return file.read()

    def test_every_verb_has_a_page_and_is_listed(self):
        names = {"stgs.1.gz"} | {f"stgs-{verb}.1.gz" for verb in verbs()}
        self.assertGreater(len(names), 10)
        self.assertEqual(set(os.listdir(self.folder)), names)
        listed = re.search(r"^\.SH VERBS\n(.*?)^\.SH", self.page(), re.DOTALL | re.MULTILINE).group(1)
        self.assertEqual(re.findall(r"^\.BR stgs\\-([a-z]+) \(1\)$", listed, re.MULTILINE), verbs())

    def test_each_page_lists_the_options_of_its_verb(self):
        for verb in [[], *([verb] for verb in verbs())]:
            with self.subTest(verb=verb):
                heads = re.findall(r"^\\fB(\\-.*?)\\fR", self.page(*verb), re.MULTILINE)
                paged = {plain(name) for head in heads for name in head.split(", ")}
                self.assertEqual(paged, options(help_of(*verb)))

    def test_each_page_contains_the_help_of_its_verb(self):
        for verb in [[], *([verb] for verb in verbs())]:
            page = " ".join(plain(self.page(*verb)).split())
            for line in help_of(*verb).splitlines():
                # Compare the description of an option's line and all of other lines; headings and
                # usage have another layout on the page.
                text = re.split(r"\s{2,}", line.strip())[-1] if line.startswith("  ") else line
                if line.startswith("  -") and len(re.split(r"\s{2,}", line.strip())) == 1:
                    continue
                if re.match(r"Usage: |Exit codes: |[A-Z][a-z ]+:$|STGS |\s+\d ", line):
                    continue
                with self.subTest(verb=verb, line=line):
                    self.assertIn(" ".join(text.rstrip(".").split()), page)

    @unittest.skipUnless(shutil.which("man"), "needs man-db")
    def test_pages_are_well_formed(self):
        for name in os.listdir(self.folder):
            run = subprocess.run(["man", "--warnings", "-l", os.path.join(self.folder, name)],
                                 text=True, capture_output=True, check=True,
                                 env=dict(os.environ, LC_ALL="C"))
            self.assertEqual(run.stderr, "")
            self.assertIn("EXIT STATUS", run.stdout)
