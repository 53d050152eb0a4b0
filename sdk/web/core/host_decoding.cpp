// SPDX-License-Identifier: Apache-2.0
#include "host_decoding.h"

namespace stgs::web {
namespace {

constexpr std::uint64_t kTaskMemory = 256;  // of a task, besides its label and output, at most

}  // namespace

Status HostDecoding::request(Coding coding, const std::string& label,
                             std::span<const std::uint8_t> input, std::uint64_t bytes,
                             ImportMemory& memory, std::uint32_t width) {
  if (outputs_.contains({coding, label})) return {};
  STGS_ASSIGN(Lease lease,
              memory.take(bytes + label.size() + kTaskMemory, "the decoded bytes of " + label));
  const auto added = outputs_.try_emplace({coding, label}).first;
  ChargedBytes& output = added->second;
  output.lease = std::move(lease);
  output.value.resize(static_cast<std::size_t>(bytes));
  tasks_.push_back({coding, added->first.second.c_str(), input.data(),
                    static_cast<std::uint32_t>(input.size()), output.value.data(),
                    static_cast<std::uint32_t>(bytes), width});
  return {};
}

const DecodeTask* HostDecoding::next() {
  if (tasks_.empty()) return nullptr;
  current_ = tasks_.front();
  tasks_.pop_front();
  return &current_;
}

std::span<const std::uint8_t> HostDecoding::content(Coding coding, const std::string& label) const {
  const auto found = outputs_.find({coding, label});
  return found == outputs_.end() ? std::span<const std::uint8_t>() : found->second.value;
}

HostDecoding& host_decoding() {
  static HostDecoding decoding;
  return decoding;
}

}  // namespace stgs::web
