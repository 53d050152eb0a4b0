// SPDX-License-Identifier: Apache-2.0
#include "stgs/player/player.h"

#include <algorithm>
#include <cmath>
#include <exception>
#include <functional>
#include <stop_token>
#include <utility>

#include "recycling_memory.h"
#include "renderer_memory.h"
#include "stream/snapshot_source.h"
#include "stream/stream_player.h"
#include "stream/transfer_events.h"

namespace stgs::player {
namespace {

Status check(const PlayerSettings& s) {
  const auto is_valid = [](double v) { return std::isfinite(v) && v >= 0; };
  const LiveSettings& live = s.live;
  if (s.max_reads_in_flight < 1 || s.max_reads_in_flight > 64 || !is_valid(s.prefetch_seconds) ||
      !is_valid(s.resume_seconds) || !is_valid(s.layer_lead_seconds) ||
      !is_valid(s.retry_seconds) || !is_valid(live.latency_seconds) ||
      !is_valid(live.poll_seconds) || !is_valid(live.stall_seconds) ||
      !is_valid(live.skip_seconds)) {
    return usage_error(
        "player settings out of range (expected finite times of 0 s or more, and 1 to 64 reads in "
        "flight)");
  }
  return {};
}

Result<std::unique_ptr<Player>> make_player(std::unique_ptr<ByteSource> source,
                                            const PlayerSettings& settings,
                                            std::function<void()> interrupt,
                                            std::shared_ptr<TransferEvents> transfers) {
  std::pmr::memory_resource* const memory =
      settings.memory != nullptr ? settings.memory.get() : &segment_memory();
  const std::shared_ptr<Budget> budget = make_budget(settings.memory_budget);
  const auto ranges = std::make_shared<RangeSource>(std::move(source), memory, budget);
  // Ends the opening, of a local file, too.
  const std::stop_callback on_stop(settings.http.stop, [&ranges] { ranges->interrupt(); });
  try {
    if (ranges->size() > settings.max_file_bytes) {
      return Status(StatusCode::kLimit,
                    fmt::format("{}: the file is too large ({} bytes, the limit is {})",
                                ranges->name(), ranges->size(), settings.max_file_bytes));
    }
    IndexCache cache(budget);
    STGS_ASSIGN(const auto reader,
                open_snapshot(ranges, cache, settings.limits, memory, IndexLoading::kOnDemand));
    // A truncated file may still be being written.
    const bool is_final = reader->form() != SceneForm::kGrowing && reader->damage().empty();
    if (is_final) ranges->set_finished();
    OpenedFile file{reader, ranges, std::move(cache), std::move(interrupt), std::move(transfers)};
    return std::make_unique<Player>(
        std::make_unique<StreamPlayer>(std::move(file), settings, budget));
  } catch (const std::exception& e) {
    return Status(code_of(e), fmt::format("{}: cannot play: {}", ranges->name(), e.what()));
  }
}

}  // namespace

Result<std::unique_ptr<Player>> Player::open(const std::string& location,
                                             const PlayerSettings& settings) {
  STGS_TRY(check(settings));
  const auto transfers = std::make_shared<TransferEvents>(settings.on_opening_event);
  std::stop_source stop;
  // The stop token of the settings also stops the player's transfers.
  const auto linked = std::make_shared<std::stop_callback<std::function<void()>>>(
      settings.http.stop, [stop]() mutable { stop.request_stop(); });
  HttpSettings http = settings.http;
  http.max_connections =
      std::max(http.max_connections, settings.max_reads_in_flight + 1);  // one polls for growth
  http.stop = stop.get_token();
  http.on_event = [transfers, forward = settings.http.on_event](const TransferEvent& event) {
    transfers->add(event);
    if (forward) forward(event);
  };
  STGS_ASSIGN(std::unique_ptr<ByteSource> source, open_location(location, http));
  auto player = make_player(
      std::move(source), settings, [stop, linked]() mutable { stop.request_stop(); }, transfers);
  transfers->opened();
  return player;
}

Result<std::unique_ptr<Player>> Player::from_source(std::unique_ptr<ByteSource> source,
                                                    const PlayerSettings& settings,
                                                    std::function<void()> interrupt) {
  STGS_TRY(check(settings));
  return make_player(std::move(source), settings, std::move(interrupt),
                     std::make_shared<TransferEvents>());
}

Player::Player(std::unique_ptr<StreamPlayer> impl) : impl_(std::move(impl)) {}
Player::~Player() = default;

Timeline& Player::timeline() {
  return impl_->timeline();
}

void Player::play() {
  impl_->play();
}

void Player::pause() {
  impl_->pause();
}

Status Player::seek(double seconds) {
  return impl_->seek(seconds);
}

Status Player::seek_frame(std::uint32_t frame) {
  return impl_->seek_frame(frame);
}

Status Player::set_rate(double rate) {
  return impl_->set_rate(rate);
}

void Player::set_loop(bool loop) {
  impl_->set_loop(loop);
}

void Player::go_live() {
  impl_->go_live();
}

LiveState Player::live() const {
  return impl_->live();
}

double Player::advance(double now) {
  return impl_->advance(now);
}

PlayerState Player::state() const {
  return impl_->state();
}

double Player::seconds() const {
  return impl_->seconds();
}

bool Player::ready() const {
  return impl_->ready();
}

int Player::layers() const {
  return impl_->layers();
}

int Player::layer_count() const {
  return impl_->layer_count();
}

bool Player::is_complete() const {
  return impl_->is_complete();
}

std::vector<TimeRange> Player::buffered() const {
  return impl_->buffered();
}

StreamStatistics Player::statistics() const {
  return impl_->statistics();
}

std::vector<PlayerEvent> Player::take_events() {
  return impl_->take_events();
}

}  // namespace stgs::player
