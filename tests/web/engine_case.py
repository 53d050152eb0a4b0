# SPDX-License-Identifier: Apache-2.0
"""Tests that scenes pass in every engine. See package_case.py for the usage."""
from package_case import PackageCase


class EngineCase(PackageCase):
    FILES = PackageCase.FILES + ["engine_checks.js"]

    def check_boxes(self, parameters):
        """An opaque box hides the splats behind it, and is covered by those before it."""
        values = self.check("compareBoxes", parameters)
        print(parameters, values, flush=True)
        for place in ("before", "behind"):
            self.assertGreater(values[place]["psnr"], 40)
            self.assertEqual(values[place]["alone"], [255, 0, 0])
        self.assertEqual(values["before"]["middle"], [255, 0, 0])
        self.assertNotEqual(values["behind"]["middle"], [255, 0, 0])

    def check_transform(self):
        value = self.check("compareMoved()")
        print(f"moved: {value:.1f} dB", flush=True)
        self.assertGreater(value, 40)

    def check_state(self):
        """Other objects are drawn as without a scene, a scene out of sight is not drawn, and drawing changes
        no state of the context."""
        is_same, draws, changed = self.check("compareState()")
        self.assertTrue(is_same)
        self.assertEqual(draws, 0)
        self.assertEqual(changed, [])
