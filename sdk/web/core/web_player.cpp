// SPDX-License-Identifier: Apache-2.0
#include "web_player.h"

#include <algorithm>
#include <limits>
#include <utility>

#include <fmt/format.h>
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
                     double prefetch_seconds, int decodes)
    : settings_(settings_of(memory_budget, prefetch_seconds)),
      decodes_(decodes),
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
  provided_->clear();
  auto transport = std::make_unique<PageTransport>(provided_->name());
  transport_ = transport.get();
  auto executor = std::make_unique<WorkerExecutor>(ranges_, decodes_);
  executor_ = executor.get();
  player_ = std::make_unique<player::StreamPlayer>(
      player::OpenedFile{reader_, ranges_, std::move(cache_)}, settings_, budget_,
      std::move(transport), std::move(executor));
  return {};
}

double WebPlayer::step(double now, double budget) {
  player_->advance(now);
  const player::PumpResult result = player_->pump(now, budget);
  return result.progressed ? 0 : std::max(0.0, result.wake_at - now);
}

std::optional<WebPlayer::Change> WebPlayer::next_change() {
  for (const player::Timeline::SegmentRef& ref : wanted()) {
    std::weak_ptr<const Gaussians4D>& sent = sent_[ref.segment];
    if (sent.lock() == ref.set) continue;
    sent = ref.set;
    return added(ref);
  }
  // Those that a better version replaces have been sent by now.
  for (auto sent = sent_.begin(); sent != sent_.end(); ++sent) {
    if (!sent->second.expired()) continue;
    const Change dropped{.segment = sent->first};
    sent_.erase(sent);
    return dropped;
  }
  return std::nullopt;
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
