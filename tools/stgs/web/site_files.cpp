// SPDX-License-Identifier: Apache-2.0
#include "site_files.h"

#include <cstddef>

// The bytes of a file from `symbol` to `symbol`_end. The build defines the paths.
#define STGS_EMBED(symbol, path)                                                       \
  asm(".pushsection .rodata\n.balign 16\n" #symbol ":\n.incbin \"" path "\"\n" #symbol \
      "_end:\n.byte 0\n.popsection\n");                                                \
  extern "C" {                                                                         \
  extern __attribute__((visibility("hidden"))) const char symbol[];                    \
  extern __attribute__((visibility("hidden"))) const char symbol##_end[];              \
  }

STGS_EMBED(stgs_site_page, STGS_SITE_PAGE)
STGS_EMBED(stgs_site_viewer, STGS_SITE_VIEWER)
STGS_EMBED(stgs_site_worker, STGS_SITE_WORKER)
STGS_EMBED(stgs_site_sorter, STGS_SITE_SORTER)
STGS_EMBED(stgs_site_core, STGS_SITE_CORE)
STGS_EMBED(stgs_site_import, STGS_SITE_IMPORT)
STGS_EMBED(stgs_site_import_core, STGS_SITE_IMPORT_CORE)

namespace stgs::tools {
namespace {

std::string_view view(const char* begin, const char* end) {
  return {begin, static_cast<std::size_t>(end - begin)};
}

constexpr std::string_view kScript = "text/javascript; charset=utf-8";

}  // namespace

const std::string_view kPageTemplate = view(stgs_site_page, stgs_site_page_end);
const std::array<SiteFile, kSiteFiles> kSite = {{
    {"viewer.js", kScript, view(stgs_site_viewer, stgs_site_viewer_end)},
    {"stgs-worker.js", kScript, view(stgs_site_worker, stgs_site_worker_end)},
    {"stgs-sorter.js", kScript, view(stgs_site_sorter, stgs_site_sorter_end)},
    {"stgs-core.wasm", "application/wasm", view(stgs_site_core, stgs_site_core_end)},
    {"stgs-import.js", kScript, view(stgs_site_import, stgs_site_import_end)},
    {"stgs-import.wasm", "application/wasm",
     view(stgs_site_import_core, stgs_site_import_core_end)},
}};

}  // namespace stgs::tools
