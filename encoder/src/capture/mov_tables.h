// SPDX-License-Identifier: Apache-2.0
// Counts the memory that FFmpeg allocates for the tables of an MP4 or MOV file (ISO/IEC 14496-12)
// when it opens the file: an entry of 24 bytes for each sample, or for each 160 samples of a chunk
// of sound, and again for each edit; a number for each sample of a table of offsets or groups; and
// an entry for each fragment and track.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "file_window.h"

namespace stgs::encoder {

struct MovBox {
  std::string kind;                  // four letters
  std::uint64_t begin = 0, end = 0;  // of its content
};

// Returns whether a text contains the kind of a table.
bool has_mov_table(std::string_view text);

// Adds the tables of a file. One thread at a time.
class MovTables {
 public:
  // `file` must outlive the object.
  explicit MovTables(FileWindow& file) : file_(file) {}

  // Call these before and after the boxes in a box. end() returns false if the chunks of a
  // track are not in order, or tracks are too many.
  void begin(const MovBox& box);
  bool end(const MovBox& box);
  // Adds a box, if it is a table. Returns false if it has more entries than its box can hold.
  bool add(const MovBox& box);
  // Returns whether a file of so many bytes can hold the samples.
  bool fit(std::uint64_t bytes) const;
  // Returns the first failure of a read; the results of the other functions are invalid after it.
  const Status& failure() const { return failure_; }

 private:
  std::uint64_t number(std::uint64_t at, std::size_t bytes = 4);
  // Returns whether `entries` of so many bytes from `at` on lie within a box.
  static bool holds(const MovBox& box, std::uint64_t at, std::uint64_t entries,
                    std::uint64_t entry_bytes);
  bool add_sizes(const MovBox& box);
  bool add_counts(const MovBox& box, std::uint64_t at, std::uint64_t& sum);
  bool add_chunks(const MovBox& runs);

  FileWindow& file_;
  // Fewest bytes of the samples: of all, of those in chunks, and by the counts of offsets and
  // groups.
  std::uint64_t samples_ = 0, chunked_ = 0, offsets_ = 0, groups_ = 0;
  std::uint64_t edits_ = 0;  // of the track that has most
  std::uint64_t fragments_ = 0, tracks_ = 0;
  std::uint64_t chunks_ = 0;  // of the present track
  std::vector<MovBox> runs_;  // the tables of its chunks (stsc)
  Status failure_;
};

}  // namespace stgs::encoder
