// SPDX-License-Identifier: Apache-2.0
// Reads that the application completes later. An abandoned read retains its buffer and the source
// until it is completed.
#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <utility>
#include <vector>

#include "source.h"

namespace stgs::sdk {
namespace {

class AsyncIo {
 public:
  explicit AsyncIo(const stgs_async_io& io) : io_(io) {}
  ~AsyncIo() {
    if (io_.close != nullptr) io_.close(io_.user);
  }
  AsyncIo(const AsyncIo&) = delete;
  AsyncIo& operator=(const AsyncIo&) = delete;

  const stgs_async_io& io() const { return io_; }
  void interrupt() {
    {
      const std::lock_guard lock(mutex_);
      if (std::exchange(interrupted_, true)) return;
    }
    answered_.notify_all();
    if (io_.interrupt != nullptr) io_.interrupt(io_.user);
  }

  struct Answer {
    std::vector<std::uint8_t> bytes;
    bool completed = false;
    int error = 0;
  };
  void complete(Answer& answer, int error) {
    {
      const std::lock_guard lock(mutex_);
      answer.error = error;
      answer.completed = true;
    }
    answered_.notify_all();
  }
  // Waits for the answer. Returns false if it was interrupted or abandoned before that.
  // `should_continue` is polled; empty: wait in any case.
  bool wait_for(const Answer& answer, const std::function<bool()>& should_continue) {
    constexpr std::chrono::milliseconds kPoll{250};
    std::unique_lock lock(mutex_);
    const auto ended = [&] { return answer.completed || interrupted_; };
    while (!answered_.wait_for(lock, kPoll, ended)) {
      lock.unlock();
      const bool wait_on = !should_continue || should_continue();
      lock.lock();
      if (!wait_on) break;
    }
    return answer.completed;
  }
  bool is_interrupted() {
    const std::lock_guard lock(mutex_);
    return interrupted_;
  }

 private:
  const stgs_async_io io_;
  std::mutex mutex_;  // guards interrupted_ and all answers
  std::condition_variable answered_;
  bool interrupted_ = false;
};

}  // namespace
}  // namespace stgs::sdk

struct stgs_read {
  std::shared_ptr<stgs::sdk::AsyncIo> source;
  std::shared_ptr<stgs::sdk::AsyncIo::Answer> answer;
};

namespace stgs::sdk {
namespace {

class AsyncSource final : public ByteSource {
 public:
  explicit AsyncSource(std::shared_ptr<AsyncIo> caller)
      : caller_(std::move(caller)), size_(caller_->io()) {}

  std::uint64_t size() const override { return size_.bytes(); }
  bool may_grow() const override { return size_.may_grow(); }
  stgs::Result<Change> refresh(std::uint64_t kept) override { return size_.refresh(kept); }
  const std::string& name() const override { return name_; }
  Status read(std::uint64_t offset, std::span<std::uint8_t> out) const override {
    return read_while({}, offset, out);
  }
  Status read_while(const std::function<bool()>& should_continue, std::uint64_t offset,
                    std::span<std::uint8_t> out) const override {
    const stgs_async_io& io = caller_->io();
    STGS_TRY(check_range(name_, size(), offset, out.size()));
    if (out.empty()) return {};
    if (caller_->is_interrupted()) return interrupted();
    const auto answer = std::make_shared<AsyncIo::Answer>();
    answer->bytes.resize(out.size());
    auto* read = new stgs_read{caller_, answer};  // the application owns and completes it
    io.begin(io.user, read, offset, answer->bytes.data(), out.size());
    if (!caller_->wait_for(*answer, should_continue)) return interrupted();
    if (answer->error != 0) {
      return io_error("{}: reading {} bytes at offset {} failed with error {}", name_, out.size(),
                      offset, answer->error);
    }
    std::copy(answer->bytes.begin(), answer->bytes.end(), out.begin());
    return {};
  }

 private:
  Status interrupted() const { return runtime_error("{}: the read was interrupted", name_); }

  std::shared_ptr<AsyncIo> caller_;
  CallerSize size_;
  std::string name_ = "application source";
};

}  // namespace

CallerSource callback_source(const stgs_async_io& io) {
  auto caller = share_caller<AsyncIo>(io);
  return {std::make_unique<AsyncSource>(caller), [caller] { caller->interrupt(); }};
}

}  // namespace stgs::sdk

extern "C" void stgs_read_complete(stgs_read* read, int error) {
  if (read == nullptr) return;
  read->source->complete(*read->answer, error);
  delete read;
}
