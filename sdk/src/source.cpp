// SPDX-License-Identifier: Apache-2.0
#include "source.h"

#include <algorithm>

namespace stgs::sdk {
namespace {

class BorrowedSource final : public ByteSource {
 public:
  explicit BorrowedSource(std::span<const std::uint8_t> bytes) : bytes_(bytes) {}

  std::uint64_t size() const override { return bytes_.size(); }
  const std::string& name() const override { return name_; }
  Status read(std::uint64_t offset, std::span<std::uint8_t> out) const override {
    STGS_TRY(check_range(name_, size(), offset, out.size()));
    std::copy_n(bytes_.begin() + static_cast<std::ptrdiff_t>(offset), out.size(), out.begin());
    return {};
  }

 private:
  std::span<const std::uint8_t> bytes_;
  std::string name_ = "memory";
};

class CallbackSource final : public ByteSource {
 public:
  explicit CallbackSource(const stgs_io& io) : io_(io) {}
  ~CallbackSource() override {
    if (io_.close != nullptr) io_.close(io_.user);
  }
  CallbackSource(const CallbackSource&) = delete;
  CallbackSource& operator=(const CallbackSource&) = delete;

  std::uint64_t size() const override { return io_.size; }
  const std::string& name() const override { return name_; }
  Status read(std::uint64_t offset, std::span<std::uint8_t> out) const override {
    STGS_TRY(check_range(name_, size(), offset, out.size()));
    if (out.empty()) return {};
    if (const int error = io_.read(io_.user, offset, out.data(), out.size()); error != 0) {
      return io_error("{}: reading {} bytes from {} on failed with {}", name_, out.size(), offset,
                      error);
    }
    return {};
  }

 private:
  stgs_io io_;
  std::string name_ = "the application's source";
};

}  // namespace

std::unique_ptr<ByteSource> borrowed_source(std::span<const std::uint8_t> bytes) {
  return std::make_unique<BorrowedSource>(bytes);
}

std::unique_ptr<ByteSource> callback_source(const stgs_io& io) {
  return std::make_unique<CallbackSource>(io);
}

}  // namespace stgs::sdk
