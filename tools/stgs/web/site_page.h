// SPDX-License-Identifier: Apache-2.0
// The viewer page with its settings, as it is served and as it is written to a site.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <string_view>

#include "stgs/format/byte_source.h"
#include "stgs/format/status.h"

namespace stgs::tools {

struct PageSettings {
  std::string title;  // of the page until the scene is open; UTF-8
  std::string scene;  // URL relative to the page, or absolute; "": the visitor chooses
  // Origins of pages that may embed this one and control it, separated by spaces; "": none.
  std::string bridge;
  std::string list;  // URL of a list of scenes (ServedScenes::list()); "": none
};

// Returns the page. Any text in the settings is safe.
std::string site_page(const PageSettings& settings);

// The content of a page of one file.
struct SinglePageContent {
  const ByteSource& scene;
  const ByteSource* audio = nullptr;  // of the scene; null: none
  std::string_view audio_type = {};   // media type of `audio`
};

// Writes the page with the files of the viewer and the content in it: one file, which a browser
// opens from disk. `write` receives it piece by piece.
using WriteBytes = std::function<Status(std::span<const std::uint8_t>)>;
Status write_single_page(const PageSettings& settings, const SinglePageContent& content,
                         const WriteBytes& write);

// Greatest scene and greatest audio file of such a page, bytes. A browser holds their text, and
// then their bytes, in memory.
inline constexpr std::uint64_t kMaxSinglePageScene = std::uint64_t{256} << 20;
inline constexpr std::uint64_t kMaxSinglePageAudio = std::uint64_t{32} << 20;

}  // namespace stgs::tools
