// SPDX-License-Identifier: Apache-2.0
#include "stream/stream_player.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "stream/stream_timeline.h"

namespace stgs::player {
namespace {

std::string replaced_message(const std::string& name) {
  return fmt::format("{}: the file was overwritten or truncated; open it again", name);
}

bool is_followed(const OpenedFile& file, const PlayerSettings& settings) {
  return settings.live.follow && file.source->may_grow() &&
         file.reader->form() == SceneForm::kGrowing;
}

}  // namespace

StreamPlayer::StreamPlayer(const PlayerSettings& settings, OpenedFile& file,
                           std::shared_ptr<Budget> budget,
                           std::unique_ptr<AsyncByteSource> transport,
                           std::unique_ptr<DecodeExecutor> executor)
    : interrupt_(std::move(file.interrupt)),
      transfers_(std::move(file.transfers)),
      time_base_(file.reader->metadata().time_base),
      playback_(settings, time_base_, extent_of(*file.reader), is_followed(file, settings)),
      store_(file.reader, file.source, settings, std::move(budget), std::move(transport),
             std::move(executor),
             [transfers = transfers_, message = replaced_message(file.source->name())](
                 bool replaced) { transfers->set_replaced(replaced, message); }),
      timeline_(make_stream_timeline(store_, file.source->name())) {
  if (!playback_.live().growing && file.reader->unloaded().empty()) return;
  follower_ = std::make_unique<Follower>(
      store_, file.source, std::move(file.cache), settings, playback_.live().growing,
      [transfers = transfers_](bool replaced, const std::string& message) {
        transfers->set_replaced(replaced, message);
      });
}

StreamPlayer::StreamPlayer(OpenedFile file, const PlayerSettings& settings,
                           std::shared_ptr<Budget> budget,
                           std::unique_ptr<AsyncByteSource> transport,
                           std::unique_ptr<DecodeExecutor> executor)
    : StreamPlayer(settings, file, std::move(budget), std::move(transport), std::move(executor)) {
  apply_effects();
}

StreamPlayer::StreamPlayer(OpenedFile file, const PlayerSettings& settings,
                           std::shared_ptr<Budget> budget)
    : StreamPlayer(
          settings, file, std::move(budget),
          std::make_unique<BlockingAdapter>(file.source, settings.max_reads_in_flight),
          std::make_unique<CpuExecutor>(SegmentDecoder(file.source->name(), settings.memory),
                                        settings.task_runner)) {
  pump_thread_ = std::make_unique<PumpThread>(store_);
  store_.set_wake([pump = pump_thread_.get()](WakeReason reason) { pump->wake(reason); });
  if (follower_ != nullptr) {
    follow_thread_ = std::make_unique<FollowThread>(*follower_);
    store_.set_on_unknown([thread = follow_thread_.get()] { thread->wake(); });
  }
  // Nothing is fetched before this, so that a failure until now does not wait for a read.
  apply_effects();
}

StreamPlayer::~StreamPlayer() {
  store_.stop();
  if (follow_thread_ != nullptr) follow_thread_->stop();
  if (interrupt_) interrupt_();
  if (pump_thread_ != nullptr) pump_thread_->stop();
}

PumpResult StreamPlayer::pump(double now, double budget) noexcept {
  const double wake_at = follower_ != nullptr ? follower_->step() : PumpResult().wake_at;
  if (follower_ != nullptr && follower_->is_done()) follower_.reset();
  PumpResult out = store_.pump(now, budget);
  out.wake_at = std::min(out.wake_at, wake_at);
  return out;
}

void StreamPlayer::play() {
  playback_.play();
  apply_effects();
}

void StreamPlayer::pause() {
  playback_.pause();
  apply_effects();
}

Status StreamPlayer::seek(double seconds) {
  Status status = playback_.seek(seconds);
  apply_effects();
  return status;
}

Status StreamPlayer::seek_frame(std::uint32_t frame) {
  Status status = playback_.seek_frame(frame);
  apply_effects();
  return status;
}

Status StreamPlayer::set_rate(double rate) {
  Status status = playback_.set_rate(rate);
  apply_effects();
  return status;
}

void StreamPlayer::set_loop(bool loop) {
  playback_.set_loop(loop);
  apply_effects();
}

void StreamPlayer::go_live() {
  playback_.go_live();
  apply_effects();
}

double StreamPlayer::advance(double now) {
  if (!std::isfinite(now)) return seconds();
  playback_.step(now, store_);
  apply_effects();
  report_layers();
  return seconds();
}

void StreamPlayer::apply_effects() noexcept {
  const Playback::Effects effects = playback_.take_effects();
  for (std::size_t k = 0; k < effects.event_count; ++k) {
    PlayerEvent event;
    event.kind = effects.events[k].kind;
    event.seconds = effects.events[k].seconds;
    store_.push_stamped_event(std::move(event));
  }
  if (effects.playhead) store_.set_playhead(*effects.playhead, effects.jumped);
}

void StreamPlayer::report_layers() {
  const int layers = this->layers();
  if (layers == layers_) return;
  layers_ = layers;
  PlayerEvent event;
  event.kind = PlayerEvent::Kind::kLayers;
  event.layers = layers;
  store_.push_event(std::move(event));
}

std::vector<TimeRange> StreamPlayer::buffered() const {
  std::vector<TimeRange> out;
  for (const TickRange& range : store_.ready_ranges()) {
    out.push_back({time_base_.seconds(range.begin), time_base_.seconds(range.end)});
  }
  return out;
}

std::vector<PlayerEvent> StreamPlayer::take_events() {
  for (PlayerEvent& event : transfers_->take()) store_.push_event(std::move(event));
  return store_.take_events();
}

}  // namespace stgs::player
