// SPDX-License-Identifier: Apache-2.0
// Tells the linker that the host has the functions of page.h. Their code is in src/core/module.ts.
mergeInto(LibraryManager.library, {
  stgs_host_read: function () {},
  stgs_host_cancel: function () {},
  stgs_host_decode: function () {},
});
