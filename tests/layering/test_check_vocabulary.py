#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""check_vocabulary.py reports each kind of term, and respects scopes and exemptions."""
import re
import unittest

import check_vocabulary


class CheckVocabulary(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.rules, cls.exempt = check_vocabulary.load_rules()

    def findings(self, path, line):
        return list(check_vocabulary.check_line(path, 1, line, self.rules, self.exempt))

    def test_replaced_names_and_phrases_are_reported_with_their_replacement(self):
        for line, instead in [("stgs_picture p;", "stgs_image"), ("kMostFrames", "kMax"),
                              ("// drawn at a moment", "time"), ("stgs bench --full-harmonics", "--full-sh"),
                              ("// the misfit of a splat", "residual"), ('"2 error(s)"', "plural"),
                              ("// milliseconds a frame", "per"),
                              ("def test_what_is_refused(self):", "claim"),
                              ("assert_is_told(run)", "reports"), ("show_picture();", "image"),
                              ("// a file that is none", "invalid"), ("// mended by finalize", "repair")]:
            with self.subTest(line=line):
                found = self.findings("player/src/a.cpp", line)
                self.assertTrue(any(instead in finding for finding in found), found)

    def test_standard_terms_pass(self):
        for line in ("stgs_image image;", "// spherical harmonics of degree 3", "kMaxFrames = 4;",
                     "// Renders the scene at a time.", "// bytes per primitive"):
            with self.subTest(line=line):
                self.assertEqual(self.findings("player/src/a.cpp", line), [])

    def test_a_scope_limits_a_rule(self):
        adam = "// first moment of the gradient"
        self.assertEqual(self.findings("encoder/src/train/adam.cpp", adam), [])

    def test_exemptions_cover_their_span_only(self):
        self.assertEqual(self.findings("format/src/a.cpp", "WebPPicture image;"), [])
        self.assertTrue(self.findings("format/src/a.cpp", "WebPPicture picture;"))

    def test_every_rule_states_a_replacement_and_a_reason(self):
        for pattern, scope, instead, reason in self.rules:
            with self.subTest(pattern=pattern.pattern):
                self.assertIsInstance(scope, re.Pattern)
                self.assertTrue(instead and reason)


if __name__ == "__main__":
    unittest.main()
