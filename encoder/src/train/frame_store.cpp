// SPDX-License-Identifier: Apache-2.0
#include "train/frame_store.h"

#include <algorithm>
#include <atomic>
#include <chrono>

#include "half_size.h"
#include "stgs/format/parallel.h"

namespace stgs::encoder {
namespace {

// Look-ahead distance, images. It lets idle threads find the next misses among the hits, but images
// decoded early displace images that would have been hits.
constexpr std::uint64_t kLookAhead = 64;
constexpr std::uint64_t kLookAheadDivisor = 8;  // look ahead at most an eighth of the capacity
// Views that each thread decodes between two progress reports, so that little time is lost waiting
// for the last one.
constexpr std::size_t kViewsPerReport = 4;

std::uint64_t image_bytes(int width, int height) {
  return std::uint64_t{3} * static_cast<std::uint64_t>(width) * static_cast<std::uint64_t>(height);
}

}  // namespace

FrameStore::FrameStore(Source source, std::uint64_t budget, int threads)
    : source_(std::move(source)), budget_(budget), thread_count_(std::max(threads, 1)) {
  entries_.resize(2 * source_.views.size());
  statistics_.budget = budget;
}

FrameStore::~FrameStore() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  work_.notify_all();
  for (std::thread& thread : threads_) thread.join();
}

std::uint64_t FrameStore::bytes_of(std::uint64_t id) const {
  const Source::Size& size = source_.views[id / 2];
  return id % 2 == 0 ? image_bytes(size.width, size.height)
                     : image_bytes(size.width / 2, size.height / 2);
}

std::uint64_t FrameStore::bytes() const {
  std::uint64_t sum = 0;
  for (std::uint64_t id = 0; id < entries_.size(); ++id) sum += bytes_of(id);
  return sum;
}

Status FrameStore::start(const std::function<bool(std::size_t views)>& loaded) {
  if (bytes() <= budget_) return load_all(loaded);
  for (int i = 0; i < thread_count_; ++i) threads_.emplace_back([this] { work(); });
  return {};
}

Status FrameStore::load_all(const std::function<bool(std::size_t views)>& loaded) {
  const std::size_t views = source_.views.size();
  const std::size_t batch = kViewsPerReport * static_cast<std::size_t>(thread_count_);
  for (std::size_t begin = 0; begin < views; begin += batch) {
    const std::size_t end = std::min(begin + batch, views);
    STGS_TRY(load(begin, end));
    if (loaded && !loaded(end)) {
      return runtime_error("stopped when {} of {} frames were loaded", end, views);
    }
  }
  statistics_.resident = true;
  statistics_.decoded = views;
  used_ = bytes();
  return {};
}

Status FrameStore::load(std::size_t begin, std::size_t end) {
  Status first_error;
  std::atomic<bool> failed = false;
  parallel_for(begin, end, [&](std::size_t view) {
    if (failed) return;
    Result<ImagePtr> image = source_.decode(view);
    if (!image.ok()) {
      const std::lock_guard lock(mutex_);
      if (first_error.ok()) first_error = image.status();
      failed = true;
      return;
    }
    Entry &full = entries_[id_of(view, 0)], &half = entries_[id_of(view, 1)];
    half.pixels = counted(std::make_shared<const Image8>(half_size(**image)));
    full.pixels = counted(*std::move(image));
    full.state = half.state = State::kReady;
    full.resident = half.resident = true;
  });
  return first_error;
}

void FrameStore::announce(std::vector<std::uint64_t> ids) {
  {
    const std::lock_guard lock(mutex_);
    plan_ = std::move(ids);
    first_ = scanned_ = now_;
    next_after_.resize(plan_.size());
    for (Entry& entry : entries_) entry.next_use = kNeverUsed;
    for (std::size_t k = plan_.size(); k-- > 0;) {
      Entry& entry = entries_[plan_[k]];
      next_after_[k] = entry.next_use;
      entry.next_use = first_ + k;
    }
    std::set<std::pair<std::uint64_t, std::uint64_t>> by_use;
    for (const auto& [use, id] : by_use_) by_use.insert({entries_[id].next_use, id});
    by_use_ = std::move(by_use);
  }
  work_.notify_all();
}

std::size_t FrameStore::announced() const {
  const std::lock_guard lock(mutex_);
  return plan_.size() - std::min<std::size_t>(plan_.size(), now_ - first_);
}

std::uint64_t FrameStore::next() const {
  const std::lock_guard lock(mutex_);
  return now_ - first_ < plan_.size() ? plan_[now_ - first_] : kNeverUsed;
}

Result<TrainingImage> FrameStore::acquire(std::uint64_t id) {
  std::unique_lock lock(mutex_);
  Entry& entry = entries_[id];
  const bool is_next = now_ - first_ < plan_.size() && plan_[now_ - first_] == id;
  // An unannounced image delays the announced ones by one use.
  if (!is_next) ++first_;
  TrainingImage image;
  image.id = id;
  image.use = now_;
  image.next_use = is_next ? next_after_[now_ - first_] : entry.next_use;
  ++now_;
  if (entry.state == State::kAbsent || entry.state == State::kDecoding) {
    const auto begin = std::chrono::steady_clock::now();
    ++statistics_.waits;
    if (entry.state == State::kAbsent) {
      // No thread has started on it, so this one decodes it. It becomes resident if images with a
      // later use can be evicted for it.
      entry.state = State::kDecoding;
      entry.next_use = image.next_use;
      if (make_space(bytes_of(id), image.next_use)) make_resident(id);
      decode(id, lock);
    } else {
      // Nothing evicts it while waiting: its next use is the nearest of all.
      done_.wait(lock, [&] { return entry.state != State::kDecoding; });
    }
    statistics_.wait_seconds +=
        std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  }
  if (entry.state == State::kFailed) {
    entry.state = State::kAbsent;
    return std::exchange(entry.error, {});
  }
  image.pixels = entry.pixels;
  if (entry.resident) {
    set_next_use(id, image.next_use);
  } else {
    entry.pixels.reset();
    entry.state = State::kAbsent;
  }
  lock.unlock();
  work_.notify_one();
  return image;
}

FrameStatistics FrameStore::statistics() const {
  const std::lock_guard lock(mutex_);
  FrameStatistics statistics = statistics_;
  statistics.peak = memory_use_->peak;
  return statistics;
}

FrameStore::ImagePtr FrameStore::counted(ImagePtr image) const {
  const std::uint64_t bytes = image->data.size();
  const std::uint64_t now = memory_use_->bytes += bytes;
  std::uint64_t peak = memory_use_->peak;
  while (peak < now && !memory_use_->peak.compare_exchange_weak(peak, now)) {
  }
  const Image8* const pixels = image.get();
  return {pixels, [use = memory_use_, bytes, image = std::move(image)](const Image8*) {
            use->bytes -= bytes;
          }};
}

void FrameStore::work() {
  std::unique_lock lock(mutex_);
  while (!stop_) {
    const std::uint64_t id = next_job();
    if (id == kNeverUsed) {
      work_.wait(lock);
      continue;
    }
    work_.notify_one();  // more jobs may be available
    decode(id, lock);
  }
}

std::uint64_t FrameStore::next_job() {
  scanned_ = std::max(scanned_, now_);
  if (scanned_ - first_ >= plan_.size()) return kNeverUsed;
  const std::uint64_t capacity = budget_ / bytes_of(plan_[scanned_ - first_]);
  const std::uint64_t ahead =
      std::clamp(capacity / kLookAheadDivisor, std::uint64_t{threads_.size()} + 1,
                 std::max<std::uint64_t>(kLookAhead, 4 * threads_.size()));
  const std::uint64_t end = std::min(first_ + plan_.size(), now_ + ahead);
  for (; scanned_ < end; ++scanned_) {
    const std::uint64_t id = plan_[scanned_ - first_];
    if (entries_[id].state != State::kAbsent) continue;
    if (!make_space(bytes_of(id), scanned_)) return kNeverUsed;
    entries_[id].state = State::kDecoding;
    make_resident(id);
    ++scanned_;
    return id;
  }
  return kNeverUsed;
}

// Evicts images with a next use after `use`, latest first; returns false if that is not enough.
bool FrameStore::make_space(std::uint64_t bytes, std::uint64_t use) {
  if (bytes > budget_) return false;
  while (used_ + bytes > budget_) {
    if (by_use_.empty() || by_use_.rbegin()->first <= use) return false;
    evict(by_use_.rbegin()->second);
  }
  return true;
}

void FrameStore::make_resident(std::uint64_t id) {
  entries_[id].resident = true;
  used_ += bytes_of(id);
}

void FrameStore::evict(std::uint64_t id) {
  Entry& entry = entries_[id];
  by_use_.erase({entry.next_use, id});
  used_ -= bytes_of(id);
  entry.resident = false;
  entry.pixels.reset();
  entry.state = State::kAbsent;
  scanned_ = std::min(scanned_, entry.next_use);
}

void FrameStore::set_next_use(std::uint64_t id, std::uint64_t use) {
  Entry& entry = entries_[id];
  const bool listed = by_use_.erase({entry.next_use, id}) > 0;
  entry.next_use = use;
  if (listed) by_use_.insert({use, id});
}

void FrameStore::decode(std::uint64_t id, std::unique_lock<std::mutex>& lock) {
  const std::size_t view = id / 2;
  const bool half = id % 2 == 1;
  ImagePtr full = half ? entries_[id_of(view, 0)].pixels : nullptr;
  const bool fresh = full == nullptr;
  lock.unlock();
  ImagePtr pixels;
  Status status;
  try {
    if (fresh) {
      Result<ImagePtr> image = source_.decode(view);
      status = image.status();
      if (image.ok()) full = counted(*std::move(image));
    }
    if (full != nullptr)
      pixels = half ? counted(std::make_shared<const Image8>(half_size(*full))) : full;
  } catch (const std::exception& error) {
    status = runtime_error("decoding a training frame: {}", error.what());
  }
  lock.lock();
  Entry& entry = entries_[id];
  if (fresh) ++statistics_.decoded;
  if (pixels != nullptr) {
    entry.state = State::kReady;
    entry.pixels = std::move(pixels);
    if (entry.resident) by_use_.insert({entry.next_use, id});
    if (half && fresh) insert_full_size(view, std::move(full));
  } else {
    entry.state = State::kFailed;
    entry.error = std::move(status);
    if (std::exchange(entry.resident, false)) used_ -= bytes_of(id);
  }
  done_.notify_all();
}

// Inserts the full size, a by-product of decoding the half size, if it fits without eviction.
void FrameStore::insert_full_size(std::size_t view, ImagePtr pixels) {
  const std::uint64_t id = id_of(view, 0);
  Entry& entry = entries_[id];
  if (entry.state != State::kAbsent || used_ + bytes_of(id) > budget_) return;
  entry.state = State::kReady;
  entry.pixels = std::move(pixels);
  make_resident(id);
  by_use_.insert({entry.next_use, id});
}

}  // namespace stgs::encoder
