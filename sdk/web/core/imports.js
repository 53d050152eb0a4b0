// SPDX-License-Identifier: Apache-2.0
// Declares the functions of page.h to the linker. The host implements them in src/core/module.ts and
// src/core/part_decoder.ts.
mergeInto(LibraryManager.library, {
  stgs_host_read: function () {},
  stgs_host_cancel: function () {},
  stgs_host_decode: function () {},
  stgs_host_part: function () {},
  stgs_host_fill: function () {},
});
