#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""check_sources.py reports each kind of violation in a synthetic tree and accepts a clean one."""
import os
import tempfile
import unittest

import check_sources

LICENCE = "// SPDX-License-Identifier: Apache-2.0\n"


class CheckSources(unittest.TestCase):
    def problems(self, files):
        with tempfile.TemporaryDirectory() as root:
            for path, text in files.items():
                full = os.path.join(root, path)
                os.makedirs(os.path.dirname(full), exist_ok=True)
                with open(full, "w", encoding="utf-8") as file:
                    file.write(text)
            return check_sources.check(root)

    def assert_violation(self, path, text, message):
        found = self.problems({path: LICENCE + text})
        self.assertEqual(len(found), 1, found)
        self.assertIn(message, found[0])

    def test_a_clean_tree_passes(self):
        self.assertEqual(self.problems({
            "format/include/stgs/format/a.h": LICENCE,
            "player/src/b.cpp": LICENCE + '#include "stgs/format/a.h"\n#include <vector>\n',
            "encoder/src/capture/c.cpp": LICENCE + "#include <opencv2/core.hpp>\n",
            "encoder/src/d.cpp": LICENCE + '#include "stgs/encoder/train.h"\n',
            "tools/stgs/e.cpp": LICENCE + '#include "stgs/player/p.h"\n#include "stgs/encoder/e.h"\n',
            "sdk/src/f.cpp": LICENCE + '#include "stgs/stgs.h"\n',
            "sdk/src/encoder/g.cpp": LICENCE + '#include "stgs/stgs.h"\n#include "stgs/encoder/e.h"\n',
            "tests/format/g.py": "#!/usr/bin/env python3\n# SPDX-License-Identifier: Apache-2.0\n",
        }), [])

    def test_forbidden_includes_are_reported(self):
        for module, target in [("format", "player"), ("format", "encoder"), ("player", "encoder"),
                               ("player", "sdk"), ("encoder", "player"), ("sdk", "encoder"),
                               ("encoder", "tools"), ("player", "tests")]:
            with self.subTest(module=module, target=target):
                self.assert_violation(f"{module}/src/a.cpp", f'#include "stgs/{target}/x.h"\n',
                                   f"{module} must not include {target}")
        self.assert_violation("sdk/src/encoder/a.cpp", '#include "stgs/player/x.h"\n',
                           "sdk/encoder must not include player")
        self.assert_violation("format/src/a.cpp", "  #  include <stgs/stgs.h>\n",
                           "format must not include sdk")

    def test_forbidden_relative_includes_are_reported(self):
        found = self.problems({
            "player/src/secret.h": LICENCE,
            "encoder/src/a.cpp": LICENCE + '#include "../../player/src/secret.h"\n',
        })
        self.assertEqual(len(found), 1, found)
        self.assertIn("encoder must not include player", found[0])

    def test_verbs_use_the_public_sdk_alone(self):
        self.assertEqual(self.problems({
            "tools/stgs/cmd_info.cpp": LICENCE + '#include "scene_info.h"\n#include "stgs/stgs.h"\n',
            "tools/stgs/scene_info.h": LICENCE + '#include "session.h"\n#include "stgs/stgs_scene.h"\n',
            "tools/stgs/session.h": LICENCE + '#include "stgs/format/status.h"\n',
            "tools/stgs/cmd_pack.cpp": LICENCE + '#include "stgs/encoder/pack.h"\n',
        }), [])
        self.assert_violation("tools/stgs/cmd_info.cpp", '#include "stgs/format/scene_file.h"\n',
                           "cmd_info.cpp:2: this verb may use only the public headers of the SDK "
                           "(stgs/format/scene_file.h)")
        found = self.problems({
            "tools/stgs/play/screen.cpp": LICENCE + '#include "vulkan_host/objects.h"\n',
            "tools/vulkan_host/objects.h": LICENCE + '#include "stgs/player/player.h"\n',
        })
        self.assertEqual(len(found), 2, found)
        self.assertIn("(stgs/player/player.h through vulkan_host/objects.h)", found[0])
        self.assertIn("objects.h:2: this verb may use only", found[1])
        found = self.problems({
            "tools/stgs/scene_info_text.cpp": LICENCE + '#include "a.h"\n',
            "tools/stgs/a.h": LICENCE + '#include "b.h"\n',
            "tools/stgs/b.h": LICENCE + '#include "a.h"\n#include "stgs/player/renderer.h"\n',
        })
        self.assertEqual(len(found), 1, found)
        self.assertIn("(stgs/player/renderer.h through b.h through a.h)", found[0])

    def test_confined_libraries_are_reported(self):
        for header, library in [("opencv2/core.hpp", "OpenCV"), ("ImfOutputFile.h", "OpenEXR"),
                                ("OpenEXR/ImfRgba.h", "OpenEXR"), ("colmap/base/x.h", "COLMAP"),
                                ("libavcodec/avcodec.h", "FFmpeg")]:
            for folder in ("format/src", "player/src", "encoder/src", "encoder/src/train"):
                with self.subTest(header=header, folder=folder):
                    self.assert_violation(f"{folder}/a.cpp", f"#include <{header}>\n",
                                       f"{library} is only for")

    def test_missing_licence_lines_are_reported(self):
        self.assertIn("no line", self.problems({"format/src/a.cpp": "int x;\n"})[0])
        self.assertIn("no line", self.problems({"tools/CMakeLists.txt": "project(x)\n"})[0])

    def test_long_files_are_reported(self):
        self.assertEqual(self.problems({"format/src/a.cpp": LICENCE + "\n" * 399}), [])
        self.assert_violation("format/src/a.cpp", "\n" * 400, "401 lines")

    def test_temporary_files_outside_their_helper_are_reported(self):
        call = "auto p = std::filesystem::temp_directory_path();\n"
        self.assert_violation("tests/format/a.cpp", call, "temporary files of tests")
        self.assertEqual(self.problems({"tests/fixtures/temporary_folder.h": LICENCE + call,
                                        "encoder/src/a.cpp": LICENCE + call}), [])

    def test_misplaced_public_headers_are_reported(self):
        self.assert_violation("format/include/stgs/other/a.h", "", "belongs in")
        self.assert_violation("player/src/include/a.h", "", "belongs in")

    def test_types_with_two_definitions_are_reported(self):
        inside = "namespace stgs {{\n{}\n}}  // namespace stgs\n"
        hidden = "namespace {{\n{}\n}}  // namespace\n"
        for other, count in [("class A final : public B {", 1), ("struct A {", 1), ("class A;", 0),
                             ("class A::C {", 0), ("template <>\nstruct A<int> {", 0),
                             ("class C {", 0), (hidden.format("class A {\n};"), 0)]:
            with self.subTest(other=other):
                found = self.problems({
                    "tools/a.h": LICENCE + inside.format("class A {\n};"),
                    "tools/b.cpp": LICENCE + inside.format(other + "\n};"),
                })
                self.assertEqual(len(found), count, found)
        self.assertIn("stgs::A is defined in", self.problems({
            path: LICENCE + inside.format("enum class A {\n};")
            for path in ("tools/a.h", "tools/b.cpp")})[0])

    def test_unknown_top_level_entries_are_reported(self):
        self.assertIn("vendored: not one of", self.problems({"vendored/a.txt": ""})[0])

    def test_ignored_folders_are_skipped(self):
        self.assertEqual(self.problems({".gitignore": "/out/\n", "out/a.cpp": ""}), [])


if __name__ == "__main__":
    unittest.main()
