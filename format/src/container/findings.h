// SPDX-License-Identifier: Apache-2.0
// Problems of a file, by stable number (spec/conformance.md, 2). Readers stop at the first error;
// the validator collects all of them. Both run the same checks.
#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "stgs/format/scene_file.h"
#include "stgs/format/status.h"

namespace stgs {

// Numbers are never reused for another problem.
enum class IssueNumber : int {
  kMoreFindings = 99,         // warning: more problems than are listed
  kUnreadable = 100,          // the source failed
  kTooShort = 101,            // fewer bytes than a header
  kMagic = 102,               // not an .stgs file, or damaged by a text-mode transfer
  kHeaderChecksum = 103,      // file header damaged
  kVersion = 104,             // unsupported major version
  kHeaderFlags = 105,         // unknown critical flag
  kFileSize = 106,            // truncated, or bytes after the end
  kHeadSize = 107,            // head_bytes outside the file
  kRecordHeader = 110,        // record header truncated or damaged
  kRecordLength = 111,        // payload extends past the end of its area
  kRecordChecksum = 112,      // payload damaged
  kUnknownCritical = 113,     // unknown critical record
  kDuplicateRecord = 114,     // a second record of the head with the same tag
  kMissingRecord = 115,       // no META or INDX
  kNotCritical = 116,         // a record without the critical bit that its tag needs
  kPrivate = 117,             // private number without the name of its owner
  kRepairedHead = 118,        // damaged head or PAGE, read from its copy
  kForeignCopy = 119,         // warning: a head copy that readers do not use
  kWrongArea = 120,           // warning: a record that is not critical in the wrong area
  kMetadataLayout = 200,      // META too short
  kMetadataConvention = 201,  // unknown kernel, axes or SH convention
  kTimeBase = 202,            // zero numerator or denominator, or no frames
  kShDegree = 203,            // unsupported SH degree
  kMetadataValue = 204,       // not finite, bounds inverted, or invalid start camera
  kMetadataText = 205,        // not UTF-8
  kWindow = 206,              // WNDW too short, or a window outside its capture
  kErrorBounds = 207,         // ERRB too short, or an invalid value
  kColour = 208,              // warning: unknown primaries or transfer function
  kIndexLayout = 300,         // truncated, or a number not in its shortest form
  kChunk = 301,               // invalid chunk length
  kSegmentInterval = 302,     // level or slot outside the part
  kSegmentOrder = 303,        // out of order
  kSegmentRange = 304,        // bytes outside the body
  kSegmentCount = 305,        // no primitives, or more than the bytes can hold
  kPrimitiveTotal = 306,      // total differs from the sum
  kPrimitiveLimit = 307,      // more primitives than the caller allows
  kMemoryLimit = 308,         // more memory than the caller allows
  kUnlistedRecord = 310,      // warning: segment record not listed in the index
  kParts = 311,               // invalid part
  kImportance = 312,          // IMPO of the wrong size or with an invalid value
  kFragment = 313,            // unusable fragment of a growing file
  kIncompleteTail = 314,      // warning: bytes after the last complete fragment
  kFurtherRecord = 315,       // truncated, or with times outside its segment
  kLink = 316,                // invalid link of a node, or too many that follow each other
  kPage = 317,                // a link leads to no PAGE record of its length
  kPlace = 318,               // two segments of one place, or with overlapping records
  kEnds = 319,                // malformed ends, or ends of primitives that do not exist
  kSegmentMismatch = 400,     // record differs from its index entry
  kStreamTable = 401,         // sizes do not add up
  kStreamMissing = 402,       // attribute missing, duplicate or out of order
  kStreamUnsupported = 403,   // unknown attribute, mapping, prediction or coder
  kStreamShape = 404,         // components, planes or exponent not allowed by the mapping
  kStreamCorrupt = 405,       // the coder fails, or the decoded size is wrong
  kStreamValue = 407,         // integer out of the range of the mapping
  kLayouts = 409,             // truncated, an invalid table, or an unknown table or layout number
  kProfile = 410,             // mapping or coder not allowed by the profile
  kNotFinite = 500,           // decoded value not finite
  kSigma = 501,               // sigma <= 0
  kRadius = 502,              // radius < 0
  kRotation = 503,            // quaternion of length 0
  kOutsideSegment = 504,      // visible outside the segment's interval
  kOutsideBounds = 505,       // warning: position outside the stated bounds
};

// Collects problems. The first error determines status().
class Findings {
 public:
  // At most this many errors are listed, and as many warnings.
  static constexpr std::size_t kMaxListed = 5000;
  // Whether errors of the file are described and listed. A search that tries many places of a file
  // only asks whether there are any: a text costs far more than the bytes that it is about.
  enum class Texts { kAll, kNone };

  Findings() = default;
  explicit Findings(Texts texts) : texts_(texts) {}
  Texts texts() const { return texts_; }

  template <typename... Args>
  void error(IssueNumber number, std::uint64_t offset, fmt::format_string<Args...> text,
             Args&&... args) {
    fail(number, StatusCode::kInvalidFile, offset,
         [&] { return fmt::format(text, std::forward<Args>(args)...); });
  }
  template <typename... Args>
  void unsupported(IssueNumber number, std::uint64_t offset, fmt::format_string<Args...> text,
                   Args&&... args) {
    fail(number, StatusCode::kUnsupported, offset,
         [&] { return fmt::format(text, std::forward<Args>(args)...); });
  }
  // Adds an error that a reader can continue after; status() stays ok.
  template <typename... Args>
  void damage(IssueNumber number, std::uint64_t offset, fmt::format_string<Args...> text,
              Args&&... args) {
    list(true, number, offset, [&] { return fmt::format(text, std::forward<Args>(args)...); });
  }
  // Adds an error for content that needs a library missing in this build, named in `status`.
  void not_built(IssueNumber number, std::uint64_t offset, const Status& status) {
    fail(number, StatusCode::kNotBuilt, offset, [&] { return status.message(); });
  }
  template <typename... Args>
  void warning(IssueNumber number, std::uint64_t offset, fmt::format_string<Args...> text,
               Args&&... args) {
    list(false, number, offset, [&] { return fmt::format(text, std::forward<Args>(args)...); });
  }
  // Adds the problems of a record that a reader can do without (spec 3.4); status() stays ok.
  void damage(Findings record) { adopt(std::move(record)); }
  // Adds an error of the source.
  void failed_read(std::uint64_t offset, const Status& status) {
    fail(IssueNumber::kUnreadable, status.code(), offset, [&] { return status.message(); });
  }
  // Adds an error of the source, or of a limit on memory (kUnsupported).
  void failed_search(std::uint64_t offset, const Status& status) {
    const bool limit = status.code() == StatusCode::kUnsupported;
    fail(limit ? IssueNumber::kMemoryLimit : IssueNumber::kUnreadable, status.code(), offset,
         [&] { return status.message(); });
  }

  bool ok() const { return status_.ok(); }
  // Returns the code of status().
  StatusCode code() const { return status_.code(); }
  // Returns the first error with the file's name, byte offset and number, or success.
  Status status(const std::string& file) const {
    if (ok() || status_.message().starts_with(file + ": ")) return status_;  // a failed read
    return {status_.code(), fmt::format("{}: {}", file, status_.message())};
  }
  // Moves the problems out. If some were not listed, the last one is a warning that states their
  // number.
  std::vector<Issue> take() {
    if (const std::uint64_t more = std::exchange(omitted_, 0); more > 0) {
      issues_.push_back({static_cast<int>(IssueNumber::kMoreFindings), false, 0,
                         fmt::format("{} more problems, which are not listed", more)});
    }
    return std::move(issues_);
  }
  void append(Findings other) {
    if (ok()) status_ = other.status_;
    adopt(std::move(other));
  }

 private:
  // Returns whether one more problem is listed.
  bool takes(bool is_error) {
    if (listed_[is_error] < kMaxListed) return ++listed_[is_error], true;
    ++omitted_;
    return false;
  }
  // `text` returns the message of a problem that is listed.
  template <typename Text>
  void list(bool is_error, IssueNumber number, std::uint64_t offset, const Text& text) {
    if (takes(is_error)) issues_.push_back({static_cast<int>(number), is_error, offset, text()});
  }
  template <typename Text>
  void fail(IssueNumber number, StatusCode code, std::uint64_t offset, const Text& text) {
    if (texts_ == Texts::kNone && code == StatusCode::kInvalidFile) {
      if (ok()) status_ = {code, {}};
      return;
    }
    if (ok()) {
      status_ = {code,
                 fmt::format("{} (byte {}, issue {})", text(), offset, static_cast<int>(number))};
    }
    list(true, number, offset, text);
  }
  void adopt(Findings other) {
    omitted_ += other.omitted_;
    for (Issue& issue : other.issues_) {
      if (takes(issue.error)) issues_.push_back(std::move(issue));
    }
  }

  Texts texts_ = Texts::kAll;
  Status status_;
  std::vector<Issue> issues_;
  std::size_t listed_[2] = {0, 0};  // warnings, errors
  std::uint64_t omitted_ = 0;
};

}  // namespace stgs
