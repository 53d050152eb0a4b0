// SPDX-License-Identifier: Apache-2.0
// The response to a request for a range, as it arrives.
#pragma once

#include <curl/curl.h>

#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "fetch/connection.h"
#include "fetch/deadline.h"

namespace stgs::player {

inline constexpr std::size_t kMaxHeaderBytes = 64 << 10;  // of a response
inline constexpr int kMaxResponses = 20;                  // of an attempt, interim ones included
inline constexpr std::size_t kMaxErrorPage = 64 << 10;    // bytes of a body that is not used

// The Content-Range header: "bytes FIRST-LAST/TOTAL", or "bytes */TOTAL" if the range does not
// exist.
struct ContentRange {
  std::optional<std::uint64_t> first, last, total;
};
ContentRange parse_content_range(std::string_view text);

// The response to one request: interim responses (1xx) and the final one.
class Reply {
 public:
  using Clock = Deadline::Clock;

  // `responses`: received before in this attempt. `min_progress`: bytes of the body that count as
  // progress. The arguments outlive the reply. Installs itself in `easy`.
  Reply(CURL* easy, std::uint64_t offset, std::span<std::uint8_t> out, std::size_t min_progress,
        int responses, Deadline& deadline, std::atomic<std::uint64_t>& total_received);
  ~Reply();
  Reply(const Reply&) = delete;
  Reply& operator=(const Reply&) = delete;

  long status() const;
  // Returns whether the response is a redirection to location() and complete.
  bool is_redirect(CURLcode result) const;
  const std::string& location() const { return location_; }
  int responses() const { return responses_; }
  std::size_t received() const { return received_; }
  bool is_connected() const { return connected_; }
  Clock::time_point last_progress() const { return last_progress_; }
  // Returns whether the body has brought bytes since then.
  bool has_trickled() const { return since_progress_ > 0; }
  // Describes the progress of a reply whose deadline has passed.
  std::string summary(double seconds) const;

  // Ends the attempt with a reason.
  void reject(std::string reason, StatusCode code = StatusCode::kIo);
  void set_error(const std::string& text);
  // Sets the outcome, the reason and the code of a request that was not stopped, and the facts of
  // the response. `conditional`: it asked for a file that has changed.
  void judge(CURLcode result, bool conditional, Attempt& attempt) const;

 private:
  bool header(std::string_view line);
  void header_field(std::string_view line);
  bool body(const char* bytes, std::size_t count);
  bool accepts();
  void note_progress();
  static int on_connected(void* reply, char*, char*, int, int);
  static std::size_t on_header(char* bytes, std::size_t size, std::size_t count, void* reply);
  static std::size_t on_body(char* bytes, std::size_t size, std::size_t count, void* reply);

  CURL* easy_;
  std::uint64_t offset_;
  std::span<std::uint8_t> out_;
  std::size_t min_progress_;
  int responses_;
  Deadline& deadline_;
  std::atomic<std::uint64_t>& total_received_;

  bool connected_ = false;                          // to the server
  Clock::time_point last_progress_ = Clock::now();  // when it connected, or the body brought data
  std::size_t since_progress_ = 0;                  // bytes of the body since then
  std::size_t header_bytes_ = 0;                    // of the current response
  std::size_t ignored_ = 0;                         // bytes of a body that is not used
  std::size_t received_ = 0;                        // bytes in out_
  ContentRange range_;
  std::string etag_, modified_, encoding_, location_;
  std::string rejection_;  // why the attempt ends; empty: it does not
  StatusCode code_ = StatusCode::kIo;
  char error_[CURL_ERROR_SIZE] = {};
};

}  // namespace stgs::player
