// SPDX-License-Identifier: Apache-2.0
#include "web_player.h"

#include <algorithm>
#include <limits>
#include <utility>

#include <fmt/format.h>
#include "packed_segment.h"
#include "renderer_memory.h"

namespace stgs::web {
namespace {

player::PlayerSettings settings_of(std::uint64_t memory_budget, double prefetch_seconds) {
  player::PlayerSettings out;
  out.memory_budget = memory_budget;
  out.prefetch_seconds = prefetch_seconds;
  out.limits.max_memory = memory_budget;
  return out;
}

}  // namespace

WebPlayer::WebPlayer(const std::string& name, std::uint64_t file_bytes, std::uint64_t memory_budget,
                     double prefetch_seconds)
    : settings_(settings_of(memory_budget, prefetch_seconds)),
      budget_(player::make_budget(memory_budget)),
      cache_(budget_) {
  auto provided = std::make_unique<ProvidedSource>(name, file_bytes);
  provided_ = provided.get();
  ranges_ = std::make_shared<player::RangeSource>(std::move(provided),
                                                  std::pmr::new_delete_resource(), budget_);
}

Status WebPlayer::open() {
  STGS_ASSIGN(reader_,
              player::open_snapshot(ranges_, cache_, settings_.limits,
                                    std::pmr::new_delete_resource(), IndexLoading::kComplete));
  if (reader_->segments().size() > kMaxSegments) {
    return Status(StatusCode::kUnsupported,
                  fmt::format("{}: {} segments, but this player has at most {}; split the file",
                              provided_->name(), reader_->segments().size(), kMaxSegments));
  }
  provided_->clear();
  auto transport = std::make_unique<PageTransport>(provided_->name());
  transport_ = transport.get();
  auto executor = std::make_unique<player::InlineExecutor>(
      player::SegmentDecoder(provided_->name(), nullptr), nullptr);
  player_ = std::make_unique<player::StreamPlayer>(
      player::OpenedFile{reader_, ranges_, std::move(cache_)}, settings_, budget_,
      std::move(transport), std::move(executor));
  return {};
}

double WebPlayer::step(double now, double budget) {
  player_->advance(now);
  const player::PumpResult result = player_->pump(now, budget);
  find_changes();
  const bool has_changes = pending_ || !dropped_.empty();
  return result.progressed || has_changes ? 0 : std::max(0.0, result.wake_at - now);
}

void WebPlayer::drop(std::uint32_t segment, std::uint32_t first_part, std::uint32_t end_part) {
  for (std::uint32_t part = first_part; part < end_part; ++part)
    dropped_.push_back(segment * kPartsPerSegment + part);
}

void WebPlayer::find_changes() {
  if (pending_) return;
  const std::vector<player::Timeline::SegmentRef> refs = wanted();
  for (const player::Timeline::SegmentRef& ref : refs) {
    const auto known = sent_.find(ref.segment);
    if (known != sent_.end() && known->second.set.lock() == ref.set) continue;
    const ScenePart& part = reader_->parts()[reader_->segments()[ref.segment].part];
    pending_ = Pending{ref.segment, ref.set, 0, part.begin_ticks + ref.set->time_origin};
    return;
  }
  // Those that a better version replaces have been sent by now.
  std::erase_if(sent_, [this](const auto& entry) {
    const bool is_gone = entry.second.set.expired();
    if (is_gone) drop(entry.first, 0, entry.second.parts);
    return is_gone;
  });
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

const WebPlayer::Change* WebPlayer::next_change() {
  if (dropped_.empty()) find_changes();
  if (!dropped_.empty()) {
    change_ = {};
    change_.id = dropped_.back();
    dropped_.pop_back();
    return &change_;
  }
  if (!pending_) return nullptr;
  pack_part();
  return &change_;
}

void WebPlayer::pack_part() {
  Pending& pending = *pending_;
  const Gaussians4D& set = *pending.set;
  const SegmentInfo& info = reader_->segments()[pending.segment];
  const std::size_t first = std::size_t{pending.part} * kPartPrimitives;
  const auto count =
      static_cast<std::uint32_t>(std::min<std::size_t>(kPartPrimitives, set.size() - first));
  change_.id = pending.segment * kPartsPerSegment + pending.part;
  change_.primitives = count;
  change_.begin = info.begin_ticks;
  change_.end = info.end_ticks;
  change_.origin = pending.origin;
  change_.sh_degree = reader_->sh_degree();
  change_.packed.resize(static_cast<std::size_t>(player::packed_bytes(count, change_.sh_degree)));
  player::pack_segment(set, first, count, change_.sh_degree, change_.packed.data());
  if (first + count < set.size()) {
    ++pending.part;
    return;
  }
  Sent& sent = sent_[pending.segment];
  const std::uint32_t parts = pending.part + 1;
  drop(pending.segment, parts, sent.parts);  // of a longer version
  sent = {pending.set, parts};
  pending_.reset();
}

}  // namespace stgs::web
