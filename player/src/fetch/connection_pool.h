// SPDX-License-Identifier: Apache-2.0
// The connections of a source, which its reads share.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <vector>

#include "fetch/connection.h"

namespace stgs::player {

// Lends up to HttpSettings::max_connections connections to reads, in the order in which they ask.
// Thread-safe.
class ConnectionPool {
 public:
  // Borrows `url` and `settings`.
  ConnectionPool(const std::string& url, const HttpSettings& settings)
      : url_(url), settings_(settings) {}

  // A borrowed connection, which the destructor gives back. One thread at a time.
  class Lease {
   public:
    enum class Outcome { kOpen, kStopped, kTimedOut, kOutOfMemory };

    // Waits if all connections are in use: until HttpSettings::request_seconds have passed in which
    // the reads that have the connections were slower, together, than min_bytes_per_second.
    // kStopped after a stop request, or if `is_wanted`, which is polled, returns false.
    Lease(ConnectionPool& pool, const std::function<bool()>& is_wanted);
    ~Lease();
    Lease(const Lease&) = delete;
    Lease& operator=(const Lease&) = delete;

    Connection* get() const { return connection_.get(); }  // null unless kOpen
    Outcome outcome() const { return outcome_; }

   private:
    ConnectionPool& pool_;
    std::unique_ptr<Connection> connection_;
    Outcome outcome_;
  };

 private:
  Lease::Outcome wait(std::uint64_t ticket, const std::function<bool()>& is_wanted,
                      std::unique_lock<std::mutex>& lock);

  const std::string& url_;
  const HttpSettings& settings_;
  std::atomic<std::uint64_t> received_ = 0;  // bytes of the file, over all connections

  std::mutex mutex_;  // guards the following members
  std::condition_variable_any freed_;
  std::vector<std::unique_ptr<Connection>> free_;
  int opened_ = 0;
  std::set<std::uint64_t> waiting_;  // tickets; the smallest is the next to get a connection
  std::uint64_t next_ticket_ = 0;
};

}  // namespace stgs::player
