// SPDX-License-Identifier: Apache-2.0
#include "source.h"

#include <algorithm>
#include <cstdint>
#include <mutex>
#include <new>
#include <utility>
#include <vector>

namespace stgs::sdk {
namespace {

class BorrowedSource : public ByteSource {
 public:
  BorrowedSource(std::span<const std::uint8_t> bytes, const std::string& name)
      : bytes_(bytes), name_(name.empty() ? "memory" : name) {}

  std::uint64_t size() const override { return bytes_.size(); }
  const std::string& name() const override { return name_; }
  Status read(std::uint64_t offset, std::span<std::uint8_t> out) const override {
    STGS_TRY(check_range(name_, size(), offset, out.size()));
    std::copy_n(bytes_.begin() + static_cast<std::ptrdiff_t>(offset), out.size(), out.begin());
    return {};
  }

 private:
  std::span<const std::uint8_t> bytes_;
  std::string name_;
};

class CopiedSource final : public BorrowedSource {
 public:
  CopiedSource(std::unique_ptr<std::pmr::vector<std::uint8_t>> bytes,
               std::shared_ptr<std::pmr::memory_resource> memory, const std::string& name)
      : BorrowedSource(*bytes, name), memory_(std::move(memory)), bytes_(std::move(bytes)) {}

 private:
  std::shared_ptr<std::pmr::memory_resource> memory_;
  std::unique_ptr<std::pmr::vector<std::uint8_t>> bytes_;
};

// Closes the caller's source when the last reference goes away.
class CallerIo {
 public:
  explicit CallerIo(const stgs_io& io) : io_(io) {}
  ~CallerIo() {
    if (io_.close != nullptr) io_.close(io_.user);
  }
  CallerIo(const CallerIo&) = delete;
  CallerIo& operator=(const CallerIo&) = delete;

  const stgs_io& io() const { return io_; }
  void interrupt() {
    std::call_once(interrupted_, [this] {
      if (io_.interrupt != nullptr) io_.interrupt(io_.user);
    });
  }

 private:
  const stgs_io io_;
  std::once_flag interrupted_;
};

class CallbackSource final : public ByteSource {
 public:
  CallbackSource(std::shared_ptr<const CallerIo> caller, const std::string& name)
      : caller_(std::move(caller)),
        size_(caller_->io()),
        name_(name.empty() ? "application source" : name) {}

  std::uint64_t size() const override { return size_.bytes(); }
  bool may_grow() const override { return size_.may_grow(); }
  stgs::Result<Change> refresh(std::uint64_t kept) override { return size_.refresh(kept); }
  const std::string& name() const override { return name_; }
  Status read(std::uint64_t offset, std::span<std::uint8_t> out) const override {
    const stgs_io& io = caller_->io();
    STGS_TRY(check_range(name_, size(), offset, out.size()));
    if (out.empty()) return {};
    if (const int error = io.read(io.user, offset, out.data(), out.size()); error != 0) {
      return io_error("{}: reading {} bytes at offset {} failed with error {}", name_, out.size(),
                      offset, error);
    }
    return {};
  }

 private:
  std::shared_ptr<const CallerIo> caller_;
  CallerSize size_;
  std::string name_;
};

}  // namespace

ByteSource::Change CallerSize::refresh(std::uint64_t kept) {
  if (current_size_ == nullptr) return ByteSource::Change::kNone;
  const std::uint64_t bytes = current_size_(user_);
  if (bytes < kept) return ByteSource::Change::kReplaced;
  return bytes_.exchange(bytes) == bytes ? ByteSource::Change::kNone : ByteSource::Change::kResized;
}

std::unique_ptr<ByteSource> borrowed_source(std::span<const std::uint8_t> bytes,
                                            const std::string& name) {
  return std::make_unique<BorrowedSource>(bytes, name);
}

std::unique_ptr<ByteSource> copied_source(std::span<const std::uint8_t> bytes,
                                          std::shared_ptr<std::pmr::memory_resource> memory,
                                          const std::string& name) {
  if (bytes.size() > PTRDIFF_MAX) throw std::bad_alloc();  // larger than any allocation
  auto copy =
      std::make_unique<std::pmr::vector<std::uint8_t>>(bytes.begin(), bytes.end(), memory.get());
  return std::make_unique<CopiedSource>(std::move(copy), std::move(memory), name);
}

CallerSource callback_source(const stgs_io& io, const std::string& name) {
  auto caller = share_caller<CallerIo>(io);
  return {std::make_unique<CallbackSource>(caller, name), [caller] { caller->interrupt(); }};
}

}  // namespace stgs::sdk
