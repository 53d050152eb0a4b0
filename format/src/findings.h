// SPDX-License-Identifier: Apache-2.0
// What is wrong with a file, by stable number (spec/conformance.md, 2). Readers stop at the first
// error, the validator collects them all: both run the same checks.
#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "stgs/format/scene_file.h"
#include "stgs/format/status.h"

namespace stgs {

// Numbers are never reused for another meaning.
enum class IssueNumber : int {
  kUnreadable = 100,          // the source failed
  kTooShort = 101,            // fewer bytes than a header
  kMagic = 102,               // not an .stgs file, or damaged as text
  kHeaderChecksum = 103,      //
  kVersion = 104,             // another major version
  kHeaderFlags = 105,         // a critical flag that is not known
  kFileSize = 106,            // truncated, or bytes after the end
  kHeadSize = 107,            // head_bytes outside the file
  kRecordHeader = 110,        // a record header that does not fit or fails its checksum
  kRecordLength = 111,        // payload past the end of its area
  kRecordChecksum = 112,      //
  kUnknownCritical = 113,     // a critical record that is not known
  kDuplicateRecord = 114,     // a second META, LAYT, INDX, WNDW or PRIV
  kMissingRecord = 115,       // no META or INDX
  kNotCritical = 116,         // META, INDX or SEGM without the critical bit
  kPrivate = 117,             // a private number whose maker is not named
  kMendedHead = 118,          // a head that is damaged, and is read from its copy
  kForeignCopy = 119,         // warning: a copy of a head that readers do not take for this one's
  kMetadataLayout = 200,      // too short
  kMetadataConvention = 201,  // an unknown unit, axis, colour or SH convention, or profile
  kTimeBase = 202,            // zero numerator or denominator, or no frames
  kShDegree = 203,            //
  kMetadataValue = 204,       // not finite, bounds inverted, or a start camera that is none
  kMetadataText = 205,        // not UTF-8
  kWindow = 206,              // WNDW too short, or a window outside its capture
  kIndexLayout = 300,         // cut off, or a number that is not in its shortest form
  kChunk = 301,               // chunk length not positive
  kSegmentInterval = 302,     // a level or slot outside the timeline
  kSegmentOrder = 303,        // out of order
  kSegmentRange = 304,        // bytes outside the body
  kSegmentCount = 305,        // more primitives than the bytes can hold, or none
  kPrimitiveTotal = 306,      // the sum differs
  kPrimitiveLimit = 307,      // more than the caller allows
  kMemoryLimit = 308,         // more decoded bytes than the caller allows
  kUnlistedRecord = 310,      // warning: a segment record that the index does not list
  kParts = 311,               // a part outside the timeline
  kImportance = 312,          // IMPO of another size, or with a value that is none
  kFragment = 313,            // a fragment of a growing file's index that cannot be used
  kIncompleteTail = 314,      // warning: bytes after the last complete fragment
  kTimedData = 315,           // cut off, or of moments outside its segment's interval
  kSegmentMismatch = 400,     // the record differs from its index entry
  kStreamTable = 401,         // sizes do not add up
  kStreamMissing = 402,       // an attribute missing, twice or out of order
  kStreamUnsupported = 403,   // unknown attribute, mapping, prediction or coder
  kStreamShape = 404,         // components, planes or exponent outside what the mapping allows
  kStreamCorrupt = 405,       // the coder fails or gives another size
  kStreamChecksum = 406,      // decoded bytes differ
  kStreamValue = 407,         // an integer outside what the mapping allows
  kLayouts = 409,             // cut off, a table that is none, a number of none of them
  kProfile = 410,             // a mapping or coder that the profile does not have
  kNotFinite = 500,           // a decoded value is not finite
  kSigma = 501,               // sigma <= 0
  kRadius = 502,              // radius < 0
  kRotation = 503,            // quaternion of length 0
  kOutsideSegment = 504,      // visible outside its segment's interval
  kOutsideBounds = 505,       // warning: position outside the stated bounds
};

class Findings {
 public:
  template <typename... Args>
  void error(IssueNumber number, std::uint64_t offset, fmt::format_string<Args...> text,
             Args&&... args) {
    add(number, true, StatusCode::kInvalidFile, offset,
        fmt::format(text, std::forward<Args>(args)...));
  }
  template <typename... Args>
  void unsupported(IssueNumber number, std::uint64_t offset, fmt::format_string<Args...> text,
                   Args&&... args) {
    add(number, true, StatusCode::kUnsupported, offset,
        fmt::format(text, std::forward<Args>(args)...));
  }
  // An error that a reader can read past: what it does not reach is all that is lost.
  template <typename... Args>
  void damage(IssueNumber number, std::uint64_t offset, fmt::format_string<Args...> text,
              Args&&... args) {
    issues_.push_back(
        {static_cast<int>(number), true, offset, fmt::format(text, std::forward<Args>(args)...)});
  }
  // A part of the file for which this build lacks a library; `status` says which.
  void not_built(IssueNumber number, std::uint64_t offset, const Status& status) {
    add(number, true, StatusCode::kNotBuilt, offset, status.message());
  }
  template <typename... Args>
  void warning(IssueNumber number, std::uint64_t offset, fmt::format_string<Args...> text,
               Args&&... args) {
    add(number, false, StatusCode::kOk, offset, fmt::format(text, std::forward<Args>(args)...));
  }
  // What is wrong with a record that a reader does without (spec 3.4).
  void damage(Findings record) {
    for (Issue& issue : record.issues_) issues_.push_back(std::move(issue));
  }
  void failed_read(std::uint64_t offset, const Status& status) {
    add(IssueNumber::kUnreadable, true, status.code(), offset, status.message());
  }

  bool ok() const { return status_.ok(); }
  // The first error with the file's name, byte and number, or success.
  Status status(const std::string& file) const {
    if (ok() || status_.message().starts_with(file + ": ")) return status_;  // a read names it
    return {status_.code(), fmt::format("{}: {}", file, status_.message())};
  }
  std::vector<Issue> take() { return std::move(issues_); }
  void append(Findings other) {
    if (ok()) status_ = other.status_;
    for (Issue& issue : other.issues_) issues_.push_back(std::move(issue));
  }

 private:
  void add(IssueNumber number, bool is_error, StatusCode code, std::uint64_t offset,
           std::string message) {
    if (is_error && ok()) {
      status_ = {code,
                 fmt::format("{} (byte {}, issue {})", message, offset, static_cast<int>(number))};
    }
    issues_.push_back({static_cast<int>(number), is_error, offset, std::move(message)});
  }

  Status status_;
  std::vector<Issue> issues_;
};

}  // namespace stgs
