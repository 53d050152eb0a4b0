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
constexpr std::uint64_t kTrackEntry = 0xAE, kContentEncodings = 0x6D80, kContentEncoding = 0x6240,
                        kContentCompression = 0x5034, kContentCompAlgo = 0x4254;
constexpr std::uint64_t kHeaderStripping = 3;
// Of all tables together: a track has fewer than 100. Bytes that look like tables have few more.
constexpr std::size_t kMaxElements = 1 << 20;

struct Element {
  std::uint64_t id = 0, begin = 0, end = 0;  // of its content
};

class Tracks {
 public:
  explicit Tracks(const ByteSource& file) : file_(file) {}

  // Checks all tables of tracks, and what looks like one.
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

  // Returns the element at `at` within [.., end); nothing if there is none.
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
    out.end = bytes == unknown ? end : out.begin + std::min(bytes, end - out.begin);
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
      at = child->end;
    }
    return {};
  }

  Status check_table(std::uint64_t at) {
    STGS_ASSIGN(const std::optional<Element> table, element_at(at, file_.size()));
    if (!table) return {};
    return children(*table, kTrackEntry, [&](const Element& track) {
      return children(track, kContentEncodings, [&](const Element& all) {
        return children(all, kContentEncoding, [&](const Element& one) { return check(one); });
      });
    });
  }

  Status check(const Element& encoding) {
    bool is_stripping = false, is_other = false;
    STGS_TRY(children(encoding, kContentCompression, [&](const Element& compression) {
      return children(compression, kContentCompAlgo, [&](const Element& algorithm) -> Status {
        const std::uint64_t bytes = std::min<std::uint64_t>(algorithm.end - algorithm.begin, 8);
        STGS_ASSIGN(const std::uint64_t value,
                    file_.number(algorithm.begin, static_cast<std::size_t>(bytes)));
        (value == kHeaderStripping ? is_stripping : is_other) = true;
        return {};
      });
    }));
    if (is_stripping && !is_other) return {};
    return damaged("has a compressed track");
  }

  Status damaged(std::string_view what) const {
    return invalid_file(
        "{}: the video {}; copy it into a new file (ffmpeg -i INPUT -c copy OUTPUT.mkv)",
        file_.name(), what);
  }

  FileWindow file_;
  std::size_t elements_ = 0;  // examined so far
};

}  // namespace

Status check_matroska_tracks(const ByteSource& file) {
  return Tracks(file).run();
}

}  // namespace stgs::encoder
