# SPDX-License-Identifier: Apache-2.0
"""Messages do not repeat passwords and queries of URLs, and other users' modules are not loaded."""
import os
import shutil
import unittest

import harness
from harness import CliTest

URLS = ("ftp://user:SECRET@host/x?token=SECRET", " http://user:SECRET@host/a", "http:/u:SECRET@h/a",
        "http:\\\\u:SECRET@h", "s3://SECRET@bucket/x", "http:///u:SECRET@h/a",
        "http://u:SECRET@127.0.0.1:1/a?token=SECRET", "http://u:SE/SECRET@127.0.0.1:1/a",
        "http://u:a(SECRET@h/a.png", "http://u:a'b\"SECRET@h/a", "http://h/a?b='SECRET",
        "http://domain\\u:SECRET@h/a")


class Secrets(CliTest):
    def test_messages_hide_passwords_and_queries(self):
        for url in URLS:
            for args in (["info", url, "--timeout", "0.5"], ["finalize", url, "-o", "a.stgs"],
                         ["render", self.fixture("tiny.stgs"), "--time", "0", "--camera", url, "-o", "null"],
                         ["train", url, "-o", "a.stgs"], [url]):
                for style in ([], ["--format", "json"]):
                    with self.subTest(url=url, args=args[:1], style=style):
                        result = self.stgs(*args, *(style if len(args) > 1 else []))
                        self.assertNotEqual(result.returncode, 0)
                        self.assertNotIn(b"SECRET", result.stderr + result.stdout)

    def test_usage_errors_hide_passwords_with_blanks(self):
        url, tiny = "http://user:SECRET PASS=SECRET@127.0.0.1:1/x?TOKEN=SECRET", self.fixture("tiny.stgs")
        for args in (["render", tiny, url, "-o", "null"], ["compare", tiny, tiny, url, "--format", "json"],
                     ["render", "--time", url, tiny, "-o", "null"], ["info", "--format", url, tiny],
                     ["info", "--format=" + url, tiny], ["info", "--unknown=" + url, tiny], ["info", "--" + url, tiny],
                     ["render", tiny, "--time", "0", "-o" + url], ["render", tiny, "--time", "0", "-o", url + ".gif"],
                     ["train", url, "-o", "a.stgs"], ["info", url, "--timeout", "0.5"], [url]):
            with self.subTest(args=args):
                result = self.stgs(*args)
                self.assertNotEqual(result.returncode, 0)
                self.assertNotIn(b"SECRET", result.stderr + result.stdout)
        self.fails(1, "unexpected argument 'http://127.0.0.1:1/x'", "render", tiny, url, "-o", "null")

    def test_urls_without_secrets_stay(self):
        self.fails(2, "http://127.0.0.1:1/folder/a.stgs: ", "info", "http://127.0.0.1:1/folder/a.stgs",
                   "--timeout", "0.5")


class Modules(CliTest):
    @unittest.skipUnless(os.path.exists(os.path.join(os.path.dirname(harness.STGS or "/"), "stgs_opencv.so")),
                         "no module next to the program")
    def test_a_module_that_others_can_replace_is_not_loaded(self):
        folder = self.path("bin")
        os.mkdir(folder)
        for name in ("stgs", "stgs_opencv.so"):
            shutil.copy(os.path.join(os.path.dirname(harness.STGS), name), folder)
        module = os.path.join(folder, "stgs_opencv.so")
        program, harness.STGS = harness.STGS, os.path.join(folder, "stgs")
        try:
            for path, mode in ((folder, 0o1777), (folder, 0o777), (module, 0o666)):
                before = os.stat(path).st_mode
                os.chmod(path, mode)
                with self.subTest(path=os.path.basename(path), mode=oct(mode)):
                    self.fails(5, "stgs_opencv.so: not loaded, because other users can replace it",
                               "prepare", harness.sample(), "-o", "out")
                os.chmod(path, before)
        finally:
            harness.STGS = program


if __name__ == "__main__":
    unittest.main()
