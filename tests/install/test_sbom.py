#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The SBOM of a built program has the fields that SPDX 2.3 requires and names the linked libraries.

usage: test_sbom.py SOURCE BUILD BINARY VERSION    BINARY is a path in BUILD
Exit code 77: the machine has no dpkg-query, or the build is not one of Ninja.
"""
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

SOURCE, BUILD, BINARY, VERSION = sys.argv[1:5]
SKIPPED = 77
PACKAGE_FIELDS = {"SPDXID", "name", "downloadLocation", "versionInfo", "licenseDeclared",
                  "licenseConcluded", "copyrightText", "supplier"}


def write(environment, binary=BINARY):
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "sbom.spdx.json")
        done = subprocess.run([sys.executable, os.path.join(SOURCE, "tools/release/sbom.py"), BUILD, VERSION, path,
                               binary], capture_output=True, text=True, check=False,
                              env=dict(os.environ, **environment))
        if done.returncode != 0:
            return done.stderr
        with open(path, encoding="utf-8") as file:
            return json.load(file)


class Sbom(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.sbom = write({"SOURCE_DATE_EPOCH": "1700000000"})
        cls.assertIsInstance(cls(), cls.sbom, dict)
        cls.packages = {package["SPDXID"]: package for package in cls.sbom["packages"]}

    def linked(self, kind):
        return {self.packages[link["relatedSpdxElement"]]["name"] for link in self.sbom["relationships"]
                if link["relationshipType"] == kind}

    def test_document(self):
        self.assertEqual(self.sbom["spdxVersion"], "SPDX-2.3")
        self.assertEqual(self.sbom["dataLicense"], "CC0-1.0")
        self.assertEqual(self.sbom["SPDXID"], "SPDXRef-DOCUMENT")
        self.assertEqual(self.sbom["name"], f"stgs-{VERSION}")
        self.assertRegex(self.sbom["documentNamespace"], r"^https://[^#\s]+$")
        self.assertEqual(self.sbom["creationInfo"]["created"], "2023-11-14T22:13:20Z")
        self.assertRegex(self.sbom["creationInfo"]["creators"][0], r"^(Tool|Person|Organization): ")

    def test_packages(self):
        self.assertEqual(len(self.packages), len(self.sbom["packages"]), "identifiers are unique")
        for package in self.packages.values():
            self.assertLessEqual(PACKAGE_FIELDS, set(package), package["name"])
            self.assertRegex(package["SPDXID"], r"^SPDXRef-[A-Za-z0-9.-]+$")
            self.assertRegex(package["licenseDeclared"],
                             r"^(NOASSERTION|[A-Za-z0-9.-]+( (OR|AND|WITH) [A-Za-z0-9.-]+)*)$")
            self.assertRegex(package["supplier"], r"^(Organization: .+|NOASSERTION)$")
            # Required of a package without analysed files.
            self.assertIs(package["filesAnalyzed"], False)
        unknown = [package["name"] for package in self.packages.values()
                   if package["licenseDeclared"] == "NOASSERTION"]
        self.assertLess(len(unknown), len(self.packages) / 2, unknown)

    def test_relations(self):
        for link in self.sbom["relationships"]:
            self.assertIn(link["relatedSpdxElement"], self.packages)
            self.assertIn(link["spdxElementId"], {*self.packages, "SPDXRef-DOCUMENT"})
            self.assertIn(link["relationshipType"], ("DESCRIBES", "DYNAMIC_LINK", "STATIC_LINK"))
        self.assertEqual(self.linked("DESCRIBES"), {os.path.basename(BINARY)})
        related = {link["relatedSpdxElement"] for link in self.sbom["relationships"]}
        self.assertEqual(related, set(self.packages), "every package is related to something")

    def test_linked_libraries_are_listed(self):
        shown = subprocess.run(["readelf", "-d", os.path.join(BUILD, BINARY)], capture_output=True, text=True,
                               check=True).stdout
        needed = re.findall(r"NEEDED.*\[lib(fmt|zstd|xxhash|hwy|draco|curl)\.so", shown)
        self.assertLessEqual({"fmt", "zstd"}, set(needed))
        shared = " ".join(self.linked("DYNAMIC_LINK"))
        for name in needed:
            self.assertIn(f"lib{name}", shared)
        # Libraries of headers alone.
        self.assertLessEqual({"libcli11-dev", "nlohmann-json3-dev"}, self.linked("STATIC_LINK"))
        self.assertNotIn("libfmt-dev", self.linked("STATIC_LINK"), "linked as a shared library")

    def test_the_same_build_gives_the_same_document(self):
        self.assertEqual(write({"SOURCE_DATE_EPOCH": "1700000000"}), self.sbom)

    def test_a_missing_binary_is_an_error(self):
        self.assertIn("no such program", write({}, "no such program"))


if __name__ == "__main__":
    if not shutil.which("dpkg-query") or not os.path.exists(os.path.join(BUILD, "build.ninja")):
        print("skipped: needs dpkg-query and a build with Ninja")
        sys.exit(SKIPPED)
    unittest.main(argv=["test_sbom.py"])
