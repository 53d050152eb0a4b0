// SPDX-License-Identifier: Apache-2.0
#include "mov_samples.h"

#include <algorithm>
#include <array>
#include <string>
#include <string_view>

#include "file_window.h"
#include "mov_tables.h"

namespace stgs::encoder {
namespace {

using std::string_view_literals::operator""sv;

constexpr int kMaxDepth = 10;
constexpr std::uint64_t kMaxSearched = std::uint64_t{16} << 20;

// Boxes that contain boxes, and nothing else. FFmpeg reads a free box that contains a movie.
constexpr std::array kContainers = {"moov"sv, "trak"sv, "mdia"sv, "minf"sv, "stbl"sv, "edts"sv,
                                    "mvex"sv, "moof"sv, "traf"sv, "dinf"sv, "udta"sv, "tref"sv,
                                    "sinf"sv, "schi"sv, "ilst"sv, "free"sv, "hoov"sv};
// Boxes in which FFmpeg finds boxes after other fields.
constexpr std::array kMixed = {"stsd"sv, "wave"sv, "iprp"sv};
constexpr std::array kEncryption = {"saiz"sv, "saio"sv, "senc"sv};

template <std::size_t kCount>
bool is_one_of(const std::array<std::string_view, kCount>& kinds, std::string_view kind) {
  return std::find(kinds.begin(), kinds.end(), kind) != kinds.end();
}

// Walks the boxes of a file as FFmpeg does (libavformat/mov.c, mov_read_default).
class Walk {
 public:
  explicit Walk(const ByteSource& file) : file_(file), tables_(file_) {}

  // `bytes`: limit of the samples.
  Status run(std::uint64_t bytes) {
    const Status walked = children(0, file_.size(), 0);
    STGS_TRY(tables_.failure());
    STGS_TRY(walked);
    return tables_.fit(bytes) ? Status() : damaged("states more samples than its bytes can hold");
  }

 private:
  Status damaged(std::string_view what) const {
    return invalid_file(
        "{}: the video {}; copy it into a new file (ffmpeg -i INPUT -c copy OUTPUT.mov)",
        file_.name(), what);
  }

  Status children(std::uint64_t at, std::uint64_t end, int depth) {
    if (depth > kMaxDepth) return damaged("nests boxes too deep");
    while (at + 8 <= end) {
      STGS_ASSIGN(std::uint64_t bytes, file_.number(at, 4));
      STGS_ASSIGN(const std::string_view text, file_.bytes(at + 4, 4));
      const std::string kind(text);
      std::uint64_t begin = at + 8;
      if (bytes == 1) {
        STGS_ASSIGN(bytes, file_.number(begin, 8));
        begin += 8;
        if (bytes == 8) bytes = 0;
      }
      if (bytes == 0) bytes = end - at;  // to the end
      if (begin > end || bytes < begin - at) return {};
      at = std::min(end, bytes > end - at ? end : at + bytes);
      STGS_TRY(visit({kind, begin, at}, depth));
    }
    return {};
  }

  Status visit(const MovBox& box, int depth) {
    if (is_one_of(kContainers, box.kind)) {
      tables_.begin(box);
      STGS_TRY(children(box.begin, box.end, depth + 1));
      return tables_.end(box) ? Status()
                              : damaged("has too many tracks, or an invalid table of chunks");
    }
    if (box.kind == "meta") return visit_metadata(box, depth);
    if (is_one_of(kMixed, box.kind)) return visit_description(box);
    if (box.kind == "cmov") return damaged("has compressed tables");
    if (is_one_of(kEncryption, box.kind)) return damaged("is encrypted");
    return tables_.add(box) ? Status() : damaged("has a table that is longer than its box");
  }

  // Finds the first box, which has the kind hdlr, in steps of 4 bytes.
  Status visit_metadata(const MovBox& box, int depth) {
    for (std::uint64_t at = box.begin; at + 8 < box.end; at += 4) {
      STGS_ASSIGN(const std::string_view kind, file_.bytes(at, 4));
      if (kind == "hdlr") return children(std::max(at, box.begin + 4) - 4, box.end, depth + 1);
    }
    return {};
  }

  // Rejects a description with the kind of a table at any offset, or with entries that FFmpeg reads
  // past the end of the box.
  Status visit_description(const MovBox& box) {
    constexpr std::uint64_t kMinEntry = 16, kVideoEntry = 86;  // bytes
    if (box.end - box.begin > kMaxSearched) return damaged("has a description of too many bytes");
    constexpr std::size_t kOverlap = 3;
    for (std::uint64_t at = box.begin; at < box.end; at += FileWindow::kBytes - kOverlap) {
      const auto count =
          static_cast<std::size_t>(std::min<std::uint64_t>(FileWindow::kBytes, box.end - at));
      STGS_ASSIGN(const std::string_view text, file_.bytes(at, count));
      if (has_mov_table(text)) return damaged("has tables in a description");
    }
    if (box.kind != "stsd") return {};
    STGS_ASSIGN(const std::uint64_t entries, file_.number(box.begin + 4, 4));
    std::uint64_t at = box.begin + 8;
    for (std::uint64_t i = 0; i < entries && at < box.end; ++i) {
      STGS_ASSIGN(const std::uint64_t bytes, file_.number(at, 4));
      if (bytes < (entries > 1 ? kVideoEntry : kMinEntry) || bytes > box.end - at)
        return damaged("has a damaged description");
      at += bytes;
    }
    return {};
  }

  FileWindow file_;
  MovTables tables_;
};

}  // namespace

Status check_mov_samples(const ByteSource& file, std::uint64_t bytes) {
  return Walk(file).run(bytes);
}

}  // namespace stgs::encoder
