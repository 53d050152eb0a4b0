// SPDX-License-Identifier: Apache-2.0
// The files of the viewer page, which the build puts into the program.
#pragma once

#include <array>
#include <string_view>

namespace stgs::tools {

struct SiteFile {
  std::string_view name;   // on the site
  std::string_view type;   // of its content, for HTTP
  std::string_view bytes;  // lives as long as the program
};

// The page, a template for site_page().
extern const std::string_view kPageTemplate;
// The script of the page, and the files that it loads from its own folder.
inline constexpr std::size_t kSiteFiles = 6;
extern const std::array<SiteFile, kSiteFiles> kSite;

// Indices of its first files.
enum SiteFileIndex : std::size_t { kViewerScript, kWorkerScript, kSorterScript, kCore };

}  // namespace stgs::tools
