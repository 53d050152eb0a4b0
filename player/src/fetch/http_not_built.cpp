// SPDX-License-Identifier: Apache-2.0
#include "stgs/player/source.h"

namespace stgs::player {

bool is_http_built() {
  return false;
}

Result<std::unique_ptr<HttpSource>> open_url(const std::string& url, const HttpSettings&) {
  return not_built("{}: this build cannot read URLs; build it with libcurl (STGS_WITH_HTTP)", url);
}

// Never created in this build.
class HttpSource::Impl {
 public:
  std::string name;
};

HttpSource::HttpSource(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
HttpSource::~HttpSource() = default;

std::uint64_t HttpSource::size() const {
  return 0;
}

const std::string& HttpSource::name() const {
  return impl_->name;
}

bool HttpSource::may_grow() const {
  return false;
}

Result<ByteSource::Change> HttpSource::refresh(std::uint64_t) {
  return Change::kNone;
}

void HttpSource::set_finished() {}

Status HttpSource::read(std::uint64_t, std::span<std::uint8_t>) const {
  return not_built("{}: this build cannot read URLs", name());
}

Status HttpSource::read_while(const std::function<bool()>&, std::uint64_t offset,
                              std::span<std::uint8_t> out) const {
  return read(offset, out);
}

TransferStatistics HttpSource::statistics() const {
  return {};
}

}  // namespace stgs::player
