// SPDX-License-Identifier: Apache-2.0
#include "stream/stream_player.h"

#include <cmath>
#include <utility>

#include "stream/stream_timeline.h"

namespace stgs::player {
namespace {

std::string replaced_message(const std::string& name) {
  return fmt::format("{}: the file was overwritten or truncated; open it again", name);
}

bool is_followed(const SceneReader& reader, const RangeSource& source,
                 const PlayerSettings& settings) {
  return settings.live.follow && source.may_grow() && reader.form() == SceneForm::kGrowing;
}

}  // namespace

StreamPlayer::StreamPlayer(const std::shared_ptr<const SceneReader>& reader,
                           const std::shared_ptr<RangeSource>& source, IndexCache cache,
                           const PlayerSettings& settings, std::function<void()> interrupt,
                           std::shared_ptr<TransferEvents> transfers)
    : interrupt_(std::move(interrupt)),
      transfers_(std::move(transfers)),
      time_base_(reader->metadata().time_base),
      playback_(settings, time_base_, extent_of(*reader), is_followed(*reader, *source, settings)),
      store_(reader, source, settings,
             [transfers = transfers_, message = replaced_message(source->name())](bool replaced) {
               transfers->set_replaced(replaced, message);
             }),
      timeline_(make_stream_timeline(store_, source->name())) {
  if (playback_.live().growing) {
    follower_ = std::make_unique<Follower>(
        store_, source, std::move(cache), settings,
        [transfers = transfers_](bool replaced, const std::string& message) {
          transfers->set_replaced(replaced, message);
        });
  }
  // Nothing is fetched before this, so that a failure until now does not wait for a read.
  apply_effects();
}

StreamPlayer::~StreamPlayer() {
  store_.stop();
  if (follower_ != nullptr) follower_->stop();
  if (interrupt_) interrupt_();
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
  const Status status = playback_.seek(seconds);
  apply_effects();
  return status;
}

Status StreamPlayer::seek_frame(std::uint32_t frame) {
  const Status status = playback_.seek_frame(frame);
  apply_effects();
  return status;
}

Status StreamPlayer::set_rate(double rate) {
  const Status status = playback_.set_rate(rate);
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
