// SPDX-License-Identifier: Apache-2.0
#include "stream/snapshot_source.h"

#include <algorithm>
#include <utility>

namespace stgs::player {
namespace {

constexpr std::uint64_t kTailBytes = 64 << 10;       // at the end of the file, read at once
constexpr std::uint64_t kMaxCachedBytes = 64 << 20;  // beyond this, the cache is cleared

// Keeps the size that the file has at construction, even if the file grows.
class SnapshotSource final : public ByteSource {
 public:
  SnapshotSource(std::shared_ptr<RangeSource> under, IndexCache& cache)
      : under_(std::move(under)), size_(under_->size()), cache_(&cache) {}

  std::uint64_t size() const override { return size_; }
  const std::string& name() const override { return under_->name(); }
  Status read(std::uint64_t offset, std::span<std::uint8_t> out) const override {
    STGS_TRY(check_range(name(), size_, offset, out.size()));
    if (cache_ != nullptr) return cache_->read(*under_, size_, offset, out);
    return under_->read(offset, out);
  }
  bool has(std::uint64_t offset, std::uint64_t bytes) const override {
    return under_->has(offset, bytes);
  }
  // Stops using the cache once the index is read: other threads read the segments.
  void detach_cache() { cache_ = nullptr; }

 private:
  const std::shared_ptr<RangeSource> under_;
  const std::uint64_t size_;
  IndexCache* cache_;
};

}  // namespace

IndexCache::Range* IndexCache::find(std::uint64_t offset, std::size_t bytes) {
  const auto after = ranges_.upper_bound(offset);
  if (after == ranges_.begin()) return nullptr;
  auto& [begin, range] = *std::prev(after);
  const std::uint64_t skipped = offset - begin;
  const bool has_all = skipped <= range.bytes.size() && bytes <= range.bytes.size() - skipped;
  return has_all ? &range : nullptr;
}

Status IndexCache::read(const ByteSource& under, std::uint64_t size, std::uint64_t offset,
                        std::span<std::uint8_t> out) {
  if (out.empty()) return {};
  Range* range = find(offset, out.size());
  const std::uint64_t tail = std::max(size - std::min(size, kTailBytes), complete_);
  std::uint64_t begin = offset;
  if (range == nullptr) {
    const bool at_end = offset > 0 && offset >= tail;
    begin = at_end ? tail : offset;
    const std::uint64_t end = at_end ? size : offset + out.size();
    std::vector<std::uint8_t> bytes(static_cast<std::size_t>(end - begin));
    STGS_TRY(under.read(begin, bytes));
    if (at_end) tail_at_ = begin;
    if (bytes_ + bytes.size() > kMaxCachedBytes) clear();
    range = &insert(begin, std::move(bytes));
  } else {
    begin = std::prev(ranges_.upper_bound(offset))->first;
  }
  range->used = true;
  std::copy_n(range->bytes.begin() + static_cast<std::ptrdiff_t>(offset - begin), out.size(),
              out.begin());
  return {};
}

IndexCache::Range& IndexCache::insert(std::uint64_t offset, std::vector<std::uint8_t> bytes) {
  Range& range = ranges_[offset];
  bytes_ += bytes.size();
  bytes_ -= range.bytes.size();
  range = {std::move(bytes), true};
  charge_.resize(bytes_);
  return range;
}

void IndexCache::recount() {
  bytes_ = 0;
  for (const auto& [begin, range] : ranges_) bytes_ += range.bytes.size();
  charge_.resize(bytes_);
}

void IndexCache::retain(std::uint64_t complete) {
  complete_ = complete;
  std::erase_if(ranges_, [](const auto& range) { return !range.second.used; });
  for (auto& [begin, range] : ranges_) range.used = false;
  tail_at_.reset();
  discard_incomplete();
}

void IndexCache::discard_incomplete() {
  ranges_.erase(ranges_.lower_bound(complete_), ranges_.end());
  for (auto& [begin, range] : ranges_) {
    const std::uint64_t valid = std::min<std::uint64_t>(range.bytes.size(), complete_ - begin);
    range.bytes.resize(static_cast<std::size_t>(valid));
  }
  recount();
}

void IndexCache::clear() {
  ranges_.clear();
  recount();
}

std::pair<std::uint64_t, std::span<const std::uint8_t>> IndexCache::tail(
    std::uint64_t complete) const {
  const auto found = tail_at_ ? ranges_.find(*tail_at_) : ranges_.end();
  if (found == ranges_.end() || complete <= *tail_at_) return {};
  const std::span<const std::uint8_t> bytes(found->second.bytes);
  const std::uint64_t valid = std::min<std::uint64_t>(bytes.size(), complete - *tail_at_);
  return {*tail_at_, bytes.first(static_cast<std::size_t>(valid))};
}

namespace {

// Ends the use of the cache by a new reader.
std::shared_ptr<const SceneReader> finish(std::unique_ptr<SceneReader> reader, RangeSource& source,
                                          IndexCache& cache) {
  if (reader->form() == SceneForm::kGrowing) {
    const auto [offset, bytes] = cache.tail(reader->file_bytes());
    if (!bytes.empty()) source.add_recent(offset, bytes);
    cache.retain(reader->final_bytes());
  } else {
    cache.clear();
  }
  return reader;
}

// Calls `make` with a source that uses the cache, and which the reader that `make` returns reads.
template <typename Make>
Result<std::shared_ptr<const SceneReader>> with_cache(const std::shared_ptr<RangeSource>& source,
                                                      IndexCache& cache, const Make& make) {
  try {
    auto snapshot = std::make_unique<SnapshotSource>(source, cache);
    SnapshotSource& snapshot_ref = *snapshot;
    Result<std::unique_ptr<SceneReader>> reader = make(std::move(snapshot));
    if (!reader.ok()) {
      cache.discard_incomplete();
      return reader.status();
    }
    snapshot_ref.detach_cache();
    return finish(std::move(reader).value(), *source, cache);
  } catch (const std::exception&) {
    cache.discard_incomplete();
    throw;
  }
}

}  // namespace

Result<std::shared_ptr<const SceneReader>> open_snapshot(const std::shared_ptr<RangeSource>& source,
                                                         IndexCache& cache,
                                                         const ReadLimits& limits,
                                                         std::pmr::memory_resource* memory,
                                                         IndexLoading loading) {
  return with_cache(source, cache, [&](std::unique_ptr<ByteSource> snapshot) {
    return SceneReader::open(std::move(snapshot), limits, memory, loading);
  });
}

Result<std::shared_ptr<const SceneReader>> extend_snapshot(
    const SceneReader& reader, const std::shared_ptr<RangeSource>& source, IndexCache& cache,
    const Extension& extend) {
  return with_cache(source, cache, [&](std::unique_ptr<ByteSource> snapshot) {
    return extend(reader, std::move(snapshot));
  });
}

}  // namespace stgs::player
