// SPDX-License-Identifier: Apache-2.0
#include "mov_samples.h"

#include <algorithm>
#include <array>
#include <string>
#include <string_view>

#include "file_window.h"

namespace stgs::encoder {
namespace {

using std::string_view_literals::operator""sv;

// A sample takes so many bytes with its place in a table, or less if it is smaller, as uncompressed
// sound.
constexpr std::uint64_t kSampleBytes = 4;
constexpr std::uint64_t kAnyFile = 65536 * kSampleBytes, kFewEdits = 4;
constexpr int kMaxDepth = 10;
constexpr std::uint64_t kMaxSearched = std::uint64_t{16} << 20;

// Boxes that contain boxes, and nothing else.
constexpr std::array kContainers = {"moov"sv, "trak"sv, "mdia"sv, "minf"sv, "stbl"sv,
                                    "edts"sv, "mvex"sv, "moof"sv, "traf"sv, "dinf"sv,
                                    "udta"sv, "tref"sv, "sinf"sv, "schi"sv, "ilst"sv};
// Boxes in which FFmpeg finds boxes after other fields.
constexpr std::array kMixed = {"stsd"sv, "meta"sv, "wave"sv, "iprp"sv};
// Boxes that FFmpeg reads as a moov box if one of these is their first box.
constexpr std::array kHiding = {"free"sv, "hoov"sv};
constexpr std::array kMovie = {"mvhd"sv, "cmov"sv};
// Boxes that state samples.
constexpr std::array kTables = {"stsz"sv, "stz2"sv, "trun"sv, "elst"sv, "cmov"sv};

template <std::size_t kCount>
bool is_one_of(const std::array<std::string_view, kCount>& kinds, std::string_view kind) {
  return std::find(kinds.begin(), kinds.end(), kind) != kinds.end();
}

struct Box {
  std::string kind;
  std::uint64_t begin = 0, end = 0;  // of its content
};

class Walk {
 public:
  explicit Walk(const ByteSource& file) : file_(file) {}

  // `bytes`: that the samples may take.
  Status run(std::uint64_t bytes) {
    STGS_TRY(children(0, file_.size(), 0));
    const std::uint64_t copies = edits_ <= kFewEdits ? 1 : edits_;
    if (bytes_ <= (kAnyFile + bytes) / copies) return {};
    return damaged("states more samples than its bytes can hold");
  }

 private:
  Status damaged(std::string_view what) const {
    return invalid_file(
        "{}: the video {}; copy it into a new file (ffmpeg -i INPUT -c copy OUTPUT.mp4)",
        file_.name(), what);
  }

  // Returns the box at `at`, which FFmpeg reads as far as `end`.
  Result<Box> box_at(std::uint64_t at, std::uint64_t end) {
    STGS_ASSIGN(std::uint64_t bytes, file_.number(at, 4));
    STGS_ASSIGN(const std::string_view kind, file_.bytes(at + 4, 4));
    Box box{std::string(kind), at + 8, end};
    if (bytes == 1) {
      STGS_ASSIGN(bytes, file_.number(at + 8, 8));
      box.begin = at + 16;
    }
    const std::uint64_t head = box.begin - at;
    if (bytes == 0) return box;  // to the end
    if (bytes < head) return damaged("has a box without its header");
    box.begin = std::min(box.begin, end);
    box.end = box.begin + std::min(bytes - head, end - box.begin);
    return box;
  }

  Status children(std::uint64_t at, std::uint64_t end, int depth) {
    if (depth > kMaxDepth) return damaged("nests boxes too deep");
    while (at + 8 <= end) {
      STGS_ASSIGN(const Box box, box_at(at, end));
      STGS_TRY(visit(box, depth));
      at = box.end;
    }
    return {};
  }

  Status visit(const Box& box, int depth) {
    if (is_one_of(kContainers, box.kind)) return children(box.begin, box.end, depth + 1);
    if (is_one_of(kMixed, box.kind)) return search(box);
    if (is_one_of(kHiding, box.kind)) {
      STGS_ASSIGN(const std::string_view first, file_.bytes(box.begin + 4, 4));
      if (is_one_of(kMovie, first)) return damaged("has its tables in a box of free space");
    }
    if (box.kind == "cmov") return damaged("has compressed tables");
    return is_one_of(kTables, box.kind) ? add_table(box) : Status();
  }

  // Adds the samples or edits of a table, whose content begins with a version and flags.
  Status add_table(const Box& box) {
    STGS_ASSIGN(const std::uint64_t first, file_.number(box.begin + 4, 4));
    STGS_ASSIGN(const std::uint64_t second, file_.number(box.begin + 8, 4));
    if (box.kind == "elst") {
      edits_ = std::max(edits_, first);
    } else if (box.kind == "trun") {
      bytes_ += kSampleBytes * first;
    } else if (box.kind == "stz2" || first == 0) {
      bytes_ += kSampleBytes * second;
    } else {
      bytes_ += std::min(first, kSampleBytes) * second;
    }
    return {};
  }

  // Rejects a table anywhere in a box.
  Status search(const Box& box) {
    if (box.end - box.begin > kMaxSearched) return damaged("has a description of too many bytes");
    constexpr std::size_t kOverlap = 3;
    for (std::uint64_t at = box.begin; at < box.end; at += FileWindow::kBytes - kOverlap) {
      const auto count =
          static_cast<std::size_t>(std::min<std::uint64_t>(FileWindow::kBytes, box.end - at));
      STGS_ASSIGN(const std::string_view text, file_.bytes(at, count));
      for (const std::string_view table : kTables) {
        if (text.find(table) != text.npos) return damaged("has tables in a description");
      }
    }
    return {};
  }

  FileWindow file_;
  std::uint64_t bytes_ = 0;  // that the samples take at least
  std::uint64_t edits_ = 0;  // of the track that has most
};

}  // namespace

Status check_mov_samples(const ByteSource& file, std::uint64_t bytes) {
  return Walk(file).run(bytes);
}

}  // namespace stgs::encoder
