// SPDX-License-Identifier: Apache-2.0
// The data of a SceneReader, for the functions of reader.cpp.
#pragma once

#include <cstdint>
#include <exception>
#include <functional>
#include <memory>
#include <memory_resource>
#include <utility>

#include "container/container.h"
#include "container/opening.h"
#include "container/segment.h"
#include "scene/reader_lists.h"
#include "stgs/format/scene_file.h"

namespace stgs {

struct SceneReader::State {
  using Extension = std::function<void(FileHead&, Findings&)>;

  // Extends the head. After an error only the head has changed.
  Status extend(const Extension& extend) {
    try {
      Findings findings;
      extend(head, findings);
      if (!findings.ok()) return findings.status(source->name());
      ReaderLists listed(head);
      std::vector<Issue> issues = findings.take();
      damage.insert(damage.end(), std::make_move_iterator(issues.begin()),
                    std::make_move_iterator(issues.end()));
      lists = std::move(listed);
      return {};
    } catch (const std::exception& e) {
      return Status(code_of(e), fmt::format("{}: {}", source->name(), e.what()));
    }
  }

  // As extend(), but keeps the head as it is after an error.
  Status change(const Extension& extension) {
    FileHead before = head;
    const Status status = extend(extension);
    if (!status.ok()) head = std::move(before);
    return status;
  }

  // Returns a reader with a copy that reads from `other`, after `call`, which must set its lists.
  Result<std::unique_ptr<SceneReader>> changed(std::unique_ptr<ByteSource> other,
                                               const std::function<Status(State&)>& call) const {
    auto state =
        std::make_unique<State>(State{std::move(other), limits, loading, memory, head, damage, {}});
    STGS_TRY(call(*state));
    return std::unique_ptr<SceneReader>(new SceneReader(std::move(state)));
  }

  // Checks whether a growing file has more bytes.
  Status check_growth() {
    if (head.closed) return {};
    STGS_ASSIGN(const ByteSource::Change changed, source->refresh(head.header.file_bytes));
    if (changed == ByteSource::Change::kReplaced) {
      return invalid_file("{}: replaced or truncated below its {} complete bytes; open it again",
                          source->name(), head.header.file_bytes);
    }
    if (source->size() < head.header.file_bytes) {
      return invalid_file("{}: shrank from {} to {} complete bytes; open it again", source->name(),
                          head.header.file_bytes, source->size());
    }
    return {};
  }

  // Returns an extension that reads the new fragments of a growing file.
  Extension growth(bool& grown) const {
    return [this, &grown](FileHead& found, Findings& findings) {
      if (!found.closed && read_growth(*source, found, grown, findings) && grown &&
          loading == IndexLoading::kComplete) {
        load_index(*source, 0, found.metadata.scene.frames, found, findings);
      }
    };
  }

  // Returns a segment; null: there is none.
  const SegmentInfo* find(std::uint32_t segment) const {
    const std::uint32_t at = segment - head.index.first;
    return at < lists.segments.size() ? &lists.segments[at] : nullptr;
  }

  // Reads the records of a segment and converts them with `make`, into `out`.
  template <typename T, typename Make>
  Result<T> with_records(std::uint32_t segment, bool with_sh, const Make& make, T out) const {
    if (find(segment) == nullptr) {
      return usage_error("{}: invalid segment index {} (the file has {} segments)", source->name(),
                         segment, lists.segments.size());
    }
    try {
      Findings findings;
      SegmentRecords records;
      if (read_segment(*source, head, segment, with_sh, records, findings) && findings.ok()) {
        make(records, head, segment, out, findings);
      }
      if (!findings.ok()) return findings.status(source->name());
      return out;
    } catch (const std::exception& e) {
      return Status(code_of(e),
                    fmt::format("{}: segment {}: {}", source->name(), segment, e.what()));
    }
  }

  Result<Gaussians4D> decode(std::uint32_t segment, bool with_sh, AttributeBits attributes,
                             TimeOrigin origin) const {
    const auto make = [=](const auto& records, const auto& file, auto ordinal, auto& set,
                          auto& findings) {
      return decode_segment(records, file, ordinal, attributes, origin, set, findings);
    };
    return with_records(segment, with_sh, make, Gaussians4D(memory));
  }

  std::unique_ptr<ByteSource> source;
  ReadLimits limits;
  IndexLoading loading;
  std::pmr::memory_resource* memory;  // of decoded sets
  FileHead head;
  std::vector<Issue> damage;
  ReaderLists lists;  // of the head
};

}  // namespace stgs
