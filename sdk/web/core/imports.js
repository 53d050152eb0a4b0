// SPDX-License-Identifier: Apache-2.0
// Declares to the linker the functions of page.h, which the host has. Their code is in src/core/module.ts.
mergeInto(LibraryManager.library, {
  stgs_host_read: function () {},
  stgs_host_cancel: function () {},
  stgs_host_decode: function () {},
});
