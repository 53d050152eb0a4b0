// SPDX-License-Identifier: Apache-2.0
#include "web_player.h"

#include <algorithm>
#include <limits>
#include <utility>

#include <fmt/format.h>
#include "page.h"
#include "renderer_memory.h"

namespace stgs::web {
namespace {

// Bytes that a segment of one part takes on the page besides its primitives, at most: a row of the
// renderer's texture, and the padding of packed_segment.h. Of longer ones, that is little.
constexpr std::uint64_t kSegmentOverhead = 52 << 10;

// Minimum seconds between two polls of a recording when its next fragment is due: each is a
// request.
constexpr double kPollSeconds = 0.2;

player::PlayerSettings settings_of(bool follows, double latency_seconds,
                                   std::uint64_t memory_budget, double prefetch_seconds) {
  player::PlayerSettings out;
  out.live.follow = follows;
  out.live.latency_seconds = latency_seconds;
  out.live.poll_seconds = kPollSeconds;
  out.memory_budget = memory_budget;
  out.prefetch_seconds = prefetch_seconds;
  out.limits.max_memory = memory_budget;
  out.segment_overhead = kSegmentOverhead;
  return out;
}

}  // namespace

WebPlayer::WebPlayer(const std::string& name, std::uint64_t file_bytes, bool follows,
                     double latency_seconds, std::uint64_t memory_budget,
                     std::uint64_t max_primitives, double prefetch_seconds, int decodes)
    : settings_(settings_of(follows, latency_seconds, memory_budget, prefetch_seconds)),
      max_primitives_(max_primitives),
      decodes_(decodes),
      budget_(player::make_budget(memory_budget)),
      cache_(budget_) {
  auto provided = std::make_unique<ProvidedSource>(name, file_bytes, budget_);
  provided_ = provided.get();
  ranges_ = std::make_shared<player::RangeSource>(std::move(provided),
                                                  std::pmr::new_delete_resource(), budget_);
}

Status WebPlayer::open() {
  STGS_ASSIGN(reader_,
              player::open_snapshot(ranges_, cache_, settings_.limits,
                                    std::pmr::new_delete_resource(), IndexLoading::kOnDemand));
  provided_->clear();
  auto transport = std::make_unique<PageTransport>(provided_->name());
  transport_ = transport.get();
  auto executor = std::make_unique<WorkerExecutor>(ranges_, decodes_);
  executor_ = executor.get();
  player_ = std::make_unique<player::StreamPlayer>(
      player::OpenedFile{reader_, ranges_, std::move(cache_)}, settings_, budget_,
      std::move(transport), std::move(executor));
  player_->limit_primitives(max_primitives_);
  return {};
}

double WebPlayer::step(double now, double budget) {
  player_->advance(now);
  const player::PumpResult result = player_->pump(now, budget);
  read_index();
  find_changes();
  return result.progressed ? 0 : std::max(0.0, result.wake_at - now);
}

void WebPlayer::read_index() {
  if (auto reader = player_->snapshot().reader; reader != reader_) {
    reader_ = std::move(reader);
    provided_->clear();
  }
  const auto& missing = provided_->missing();
  if (!missing) return provided_->clear();  // no read waits, so the bytes are no longer needed
  if (index_read_ != 0) return;
  index_offset_ = missing->offset;
  index_bytes_.resize(static_cast<std::size_t>(missing->bytes));
  index_read_ = transport_->next_id();
  stgs_host_read(index_read_, static_cast<double>(missing->offset),
                 static_cast<std::uint32_t>(missing->bytes), index_bytes_.data());
}

void WebPlayer::read_done(std::uint32_t id, const std::string& failure, std::uint64_t file_bytes,
                          double now) {
  if (id != index_read_) return transport_->done(id, failure, now);
  index_read_ = 0;
  if (failure.empty())
    return provided_->end_read(index_offset_, std::move(index_bytes_), file_bytes);
  provided_->fail_read(index_offset_, io_error("{}: {}", provided_->name(), failure));
}

void WebPlayer::find_changes() {
  changes_.clear();
  for (const auto& [segment, set] : sent_) {
    if (set.expired()) changes_.push_back({segment, 0, 0, nullptr});
  }
  std::vector<player::Timeline::SegmentRef> refs = wanted();
  std::reverse(refs.begin(), refs.end());  // those of the present last
  for (player::Timeline::SegmentRef& ref : refs) {
    const auto sent = sent_.find(ref.segment);
    if (sent == sent_.end() || sent->second.lock() != ref.set) changes_.push_back(std::move(ref));
  }
}

std::optional<WebPlayer::Change> WebPlayer::next_change() {
  while (!changes_.empty()) {
    const player::Timeline::SegmentRef ref = std::move(changes_.back());
    changes_.pop_back();
    std::weak_ptr<const Gaussians4D>& sent = sent_[ref.segment];
    if (ref.set != nullptr) {
      sent = ref.set;
      return added(ref);
    }
    if (!sent.expired()) continue;  // a new version has been added
    sent_.erase(ref.segment);
    return Change{.segment = ref.segment};
  }
  return std::nullopt;
}

std::vector<player::TimeRange> WebPlayer::buffered() const {
  constexpr std::size_t kMaxRanges = 100;
  std::vector<player::TimeRange> ranges = player_->buffered();
  if (ranges.size() <= kMaxRanges) return ranges;
  const double now = player_->seconds();
  // The present one counts as the longest.
  const auto length = [now](const player::TimeRange& range) {
    const bool is_present = range.begin <= now && now <= range.end;
    return is_present ? std::numeric_limits<double>::infinity() : range.end - range.begin;
  };
  std::nth_element(ranges.begin(), ranges.begin() + kMaxRanges, ranges.end(),
                   [&](const auto& a, const auto& b) { return length(a) > length(b); });
  ranges.resize(kMaxRanges);
  std::sort(ranges.begin(), ranges.end(),
            [](const auto& a, const auto& b) { return a.begin < b.begin; });
  return ranges;
}

WebPlayer::Change WebPlayer::added(const player::Timeline::SegmentRef& ref) const {
  const SegmentInfo& info = reader_->segments()[ref.segment];
  return {ref.segment, executor_->id_of(*ref.set), info.begin_ticks, info.end_ticks,
          reader_->parts()[info.part].begin_ticks + ref.set->time_origin};
}

std::vector<player::Timeline::SegmentRef> WebPlayer::wanted() {
  player::Timeline& timeline = player_->timeline();
  const double seconds = player_->seconds();
  auto visible = timeline.visible_segments(seconds);
  if (!visible.ok()) return {};  // nothing is usable yet
  std::vector<player::Timeline::SegmentRef> refs = std::move(*visible);
  for (auto& ref : timeline.prefetch_segments(seconds)) refs.push_back(std::move(ref));
  std::erase_if(refs, [](const auto& ref) { return ref.set == nullptr; });
  return refs;
}

}  // namespace stgs::web
