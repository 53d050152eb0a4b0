// SPDX-License-Identifier: Apache-2.0
#include "object.h"

#include <algorithm>
#include <cstdio>

#include "structs.h"

namespace stgs::sdk {
namespace {

stgs_result result_of_code(StatusCode code) {
  switch (code) {
    case StatusCode::kOk:
      return STGS_OK;
    case StatusCode::kUsage:
      return STGS_ERROR_ARGUMENT;
    case StatusCode::kIo:
      return STGS_ERROR_IO;
    case StatusCode::kInvalidFile:
      return STGS_ERROR_INVALID_FILE;
    case StatusCode::kUnsupported:
      return STGS_ERROR_UNSUPPORTED;
    case StatusCode::kNotBuilt:
      return STGS_ERROR_NOT_BUILT;
    case StatusCode::kNoMemory:
      return STGS_ERROR_OUT_OF_MEMORY;
    case StatusCode::kLimit:
      return STGS_ERROR_LIMIT;
    case StatusCode::kDeviceLost:
      return STGS_ERROR_DEVICE_LOST;
    case StatusCode::kRuntime:
    case StatusCode::kDiffers:
      break;
  }
  return STGS_ERROR_RUNTIME;
}

// Issues that mean a limit of the caller (spec/conformance.md, 2).
constexpr int kPrimitiveLimit = 307, kMemoryLimit = 308;

// Position in the file: messages of the reader end with "(byte N, issue M)".
struct Location {
  std::uint64_t offset = STGS_NO_OFFSET;
  int issue = 0;
};
Location location_of(const std::string& message) {
  const std::size_t at = message.rfind(" (byte ");
  unsigned long long offset = 0;
  int issue = 0, end = 0;
  if (at == std::string::npos ||
      std::sscanf(message.c_str() + at, " (byte %llu, issue %d)%n", &offset, &issue, &end) != 2 ||
      at + static_cast<std::size_t>(end) != message.size()) {
    return {};
  }
  return {offset, issue};
}

}  // namespace

stgs_result result_of(StatusCode code, const std::string& message) {
  const int issue = location_of(message).issue;
  const bool limit = issue == kPrimitiveLimit || issue == kMemoryLimit;
  const stgs_result result = result_of_code(code);
  return result == STGS_ERROR_UNSUPPORTED && limit ? STGS_ERROR_LIMIT : result;
}

Outcome::Outcome(Status s) : result(result_of(s.code(), s.message())), status(std::move(s)) {}

stgs_result LastError::set(stgs_result result, const char* message) {
  result_ = result;
  issue_ = 0;
  offset_ = STGS_NO_OFFSET;
  std::size_t length = std::strlen(message);
  if (length >= message_.size()) {
    length = message_.size() - 1;
    // Cut between UTF-8 characters.
    while (length > 0 && (static_cast<unsigned char>(message[length]) & 0xC0) == 0x80) --length;
  }
  std::copy_n(message, length, message_.begin());
  message_[length] = '\0';
  return result;
}

stgs_result LastError::set(const Outcome& outcome) {
  set(outcome.result, outcome.status.message().c_str());
  const Location location = location_of(outcome.status.message());
  offset_ = location.offset;
  issue_ = location.issue;
  return outcome.result;
}

stgs_result LastError::get(stgs_error* error) const {
  if (const stgs_result bad = check_struct(error); bad != STGS_OK) return bad;
  copy_out(error, {sizeof(*error), result_, issue_, offset_, message_.data()});
  return STGS_OK;
}

}  // namespace stgs::sdk

extern "C" {

uint32_t stgs_version(void) {
  return STGS_VERSION_MAJOR * 1000000 + STGS_VERSION_MINOR * 1000 + STGS_VERSION_PATCH;
}

const char* stgs_result_name(stgs_result result) {
  switch (result) {
    case STGS_OK:
      return "STGS_OK";
    case STGS_ERROR_ARGUMENT:
      return "STGS_ERROR_ARGUMENT";
    case STGS_ERROR_STRUCT_SIZE:
      return "STGS_ERROR_STRUCT_SIZE";
    case STGS_ERROR_STATE:
      return "STGS_ERROR_STATE";
    case STGS_ERROR_IO:
      return "STGS_ERROR_IO";
    case STGS_ERROR_INVALID_FILE:
      return "STGS_ERROR_INVALID_FILE";
    case STGS_ERROR_RUNTIME:
      return "STGS_ERROR_RUNTIME";
    case STGS_ERROR_OUT_OF_MEMORY:
      return "STGS_ERROR_OUT_OF_MEMORY";
    case STGS_ERROR_LIMIT:
      return "STGS_ERROR_LIMIT";
    case STGS_ERROR_CANCELLED:
      return "STGS_ERROR_CANCELLED";
    case STGS_ERROR_DEVICE_LOST:
      return "STGS_ERROR_DEVICE_LOST";
    case STGS_ERROR_TIMEOUT:
      return "STGS_ERROR_TIMEOUT";
    case STGS_ERROR_UNSUPPORTED:
      return "STGS_ERROR_UNSUPPORTED";
    case STGS_ERROR_NOT_BUILT:
      return "STGS_ERROR_NOT_BUILT";
    default:
      return "unknown result";
  }
}

}  // extern "C"
