// SPDX-License-Identifier: Apache-2.0
#include "matroska_tracks.h"

#include <algorithm>
#include <bit>
#include <optional>
#include <string_view>

#include "file_window.h"

namespace stgs::encoder {
namespace {

constexpr std::string_view kTracks = "\x16\x54\xAE\x6B";
constexpr std::uint64_t kTrackEntry = 0xAE, kTrackType = 0x83, kContentEncodings = 0x6D80,
                        kContentEncoding = 0x6240, kContentEncodingScope = 0x5032,
                        kContentCompression = 0x5034, kContentCompAlgo = 0x4254,
                        kContentCompSettings = 0x4255;
constexpr std::uint64_t kHeaderStripping = 3, kSubtitles = 0x11, kFrames = 1;
// Limit of the first bytes that a writer leaves out of each frame. FFmpeg adds them to each of up
// to 256 frames of a block.
constexpr std::uint64_t kMaxSettings = 64;
constexpr std::size_t kMaxTracks = 1000;
// Of all tables together: a track has fewer than 100. Other bytes that match their id have few.
constexpr std::size_t kMaxElements = 1 << 16;

struct Element {
  std::uint64_t id = 0, begin = 0, end = 0;  // of its content
  bool is_unknown = false;  // without a size: it ends before an element that it cannot contain
};

class Tracks {
 public:
  explicit Tracks(const ByteSource& file) : file_(file) {}

  // Checks all tables of tracks, and all bytes that match their id.
  Status run() {
    const std::size_t overlap = kTracks.size() - 1;
    for (std::uint64_t at = 0; at < file_.size(); at += FileWindow::kBytes - overlap) {
      for (std::size_t from = 0;;) {
        STGS_ASSIGN(const std::string_view text, file_.bytes(at, FileWindow::kBytes));
        const std::size_t found = text.find(kTracks, from);
        if (found == text.npos) break;
        STGS_TRY(check_table(at + found));
        from = found + 1;
      }
    }
    return {};
  }

 private:
  // Returns the number of bytes of an id or a size by its first byte; 0 if it is invalid.
  static std::size_t length_of(std::uint64_t first) {
    return first == 0
               ? 0
               : static_cast<std::size_t>(std::countl_zero(static_cast<std::uint8_t>(first))) + 1;
  }

  // Returns the element at `at`, which must end by `end`; nothing if there is none.
  Result<std::optional<Element>> element_at(std::uint64_t at, std::uint64_t end) {
    STGS_ASSIGN(const std::uint64_t id_first, file_.number(at, 1));
    const std::size_t id_bytes = length_of(id_first);
    STGS_ASSIGN(const std::uint64_t size_first, file_.number(at + id_bytes, 1));
    const std::size_t size_bytes = length_of(size_first);
    if (id_bytes == 0 || size_bytes == 0 || at + id_bytes + size_bytes > end) {
      return std::optional<Element>();
    }
    Element out;
    STGS_ASSIGN(out.id, file_.number(at, id_bytes));
    STGS_ASSIGN(const std::uint64_t size, file_.number(at + id_bytes, size_bytes));
    out.begin = at + id_bytes + size_bytes;
    const std::uint64_t unknown = (std::uint64_t{1} << 7 * size_bytes) - 1, bytes = size & unknown;
    out.is_unknown = bytes == unknown;
    out.end = out.is_unknown ? end : out.begin + std::min(bytes, end - out.begin);
    return std::optional(out);
  }

  // Calls visit(child) for the children of an element with this id, until one is invalid.
  template <typename Visit>
  Status children(const Element& of, std::uint64_t id, const Visit& visit) {
    for (std::uint64_t at = of.begin; at < of.end;) {
      STGS_ASSIGN(const std::optional<Element> child, element_at(at, of.end));
      if (!child) return {};
      if (++elements_ > kMaxElements) return damaged("has too many tables of tracks");
      if (child->id == id) STGS_TRY(visit(*child));
      at = child->is_unknown ? child->begin : child->end;
    }
    return {};
  }

  Status check_table(std::uint64_t at) {
    STGS_ASSIGN(const std::optional<Element> table, element_at(at, file_.size()));
    if (!table) return {};
    return children(*table, kTrackEntry, [&](const Element& track) {
      if (++tracks_ > kMaxTracks) return damaged("has too many tracks");
      STGS_ASSIGN(const Values type, values_of(track, kTrackType));
      return children(track, kContentEncodings, [&](const Element& all) {
        return children(all, kContentEncoding, [&](const Element& encoding) {
          return check(encoding, type.is_only(kSubtitles));
        });
      });
    });
  }

  // The values of the elements with an id.
  struct Values {
    std::size_t count = 0;
    std::uint64_t last = 0;

    bool is_only(std::uint64_t value) const { return count == 1 && last == value; }
  };

  Result<Values> values_of(const Element& of, std::uint64_t id) {
    Values out;
    STGS_TRY(children(of, id, [&](const Element& child) -> Status {
      const std::uint64_t bytes = std::min<std::uint64_t>(child.end - child.begin, 8);
      STGS_ASSIGN(out.last, file_.number(child.begin, static_cast<std::size_t>(bytes)));
      ++out.count;
      return {};
    }));
    return out;
  }

  Status check(const Element& encoding, bool is_subtitles) {
    STGS_ASSIGN(const Values scope, values_of(encoding, kContentEncodingScope));
    // Subtitles are not decoded, and this scope excludes their description.
    if (is_subtitles && scope.is_only(kFrames) && !encoding.is_unknown) return {};
    std::size_t compressions = 0;
    bool is_stripping = !encoding.is_unknown;
    STGS_TRY(children(encoding, kContentCompression, [&](const Element& compression) -> Status {
      ++compressions;
      STGS_ASSIGN(const Values algorithm, values_of(compression, kContentCompAlgo));
      is_stripping = is_stripping && algorithm.is_only(kHeaderStripping);
      return children(compression, kContentCompSettings, [&](const Element& settings) -> Status {
        is_stripping = is_stripping && settings.end - settings.begin <= kMaxSettings;
        return {};
      });
    }));
    return is_stripping && compressions == 1 ? Status()
                                             : damaged("has a compressed or encrypted track");
  }

  Status damaged(std::string_view what) const {
    return invalid_file(
        "{}: the video {}; copy it into a new file (ffmpeg -i INPUT -c copy OUTPUT.mkv)",
        file_.name(), what);
  }

  FileWindow file_;
  std::size_t elements_ = 0, tracks_ = 0;  // examined so far
};

}  // namespace

Status check_matroska_tracks(const ByteSource& file) {
  return Tracks(file).run();
}

}  // namespace stgs::encoder
