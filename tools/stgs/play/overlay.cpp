// SPDX-License-Identifier: Apache-2.0
#include "play/overlay.h"

#include <imgui.h>

#include <algorithm>

#include "session.h"

namespace stgs::tools {
namespace {

constexpr float kMargin = 8;
constexpr ImGuiWindowFlags kBare = ImGuiWindowFlags_NoDecoration | ImGuiWindowFlags_NoMove |
                                   ImGuiWindowFlags_NoSavedSettings |
                                   ImGuiWindowFlags_NoFocusOnAppearing | ImGuiWindowFlags_NoNav;
constexpr ImU32 kTrack = IM_COL32(70, 70, 70, 255), kBuffered = IM_COL32(130, 150, 170, 255),
                kPlayed = IM_COL32(90, 170, 255, 255), kHandle = IM_COL32(255, 255, 255, 255);

void text(const std::string& line) {
  ImGui::TextUnformatted(line.data(), line.data() + line.size());
}

// `state` is that of an open player.
const char* name_of(stgs_player_state state) {
  constexpr const char* kNames[] = {"paused", "playing", "buffering", "ended"};
  return kNames[state - STGS_PLAYER_PAUSED];
}

std::string megabits(double bits_per_second) {
  if (bits_per_second <= 0) return "-";
  return bits_per_second < 1e8 ? fmt::format("{:.3g} Mbit/s", 1e-6 * bits_per_second)
                               : fmt::format("{:.0f} Mbit/s", 1e-6 * bits_per_second);
}

void draw_statistics(Playback& playback, const OverlayState& state) {
  const stgs_player_statistics stream = playback.statistics();
  const stgs_player_status& player = playback.status();
  const stgs_vulkan_progress& frame = state.frame;
  ImGui::SetNextWindowPos({kMargin, kMargin});
  ImGui::SetNextWindowBgAlpha(0.6f);
  // Wide enough for most lines: ImGui fits the window to its text one frame late.
  ImGui::SetNextWindowSizeConstraints({30 * ImGui::GetFontSize(), 0}, {1e4f, 1e4f});
  ImGui::Begin("statistics", nullptr,
               kBare | ImGuiWindowFlags_AlwaysAutoResize | ImGuiWindowFlags_NoInputs);
  text(fmt::format("{:.1f} FPS  {:.1f} ms   {}x{}", state.fps, state.frame_ms, state.size.width,
                   state.size.height));
  text(state.device);
  text(fmt::format("fetch {:.2f}  slice {:.2f}  bin {:.2f}  blend {:.2f} ms", frame.prepare_ms,
                   frame.slice_ms, frame.bin_ms, frame.blend_ms));
  text(fmt::format("active {}  in view {}  stored {}", frame.active_primitives, frame.splats,
                   stream.stored_primitives));
  text(fmt::format("link {}  clip {}  fetched {}", megabits(8 * stream.bytes_per_second),
                   megabits(playback.bits_per_second()), human_bytes(stream.fetched_bytes)));
  text(fmt::format("buffer {:.1f} s  layers {} of {}", playback.buffered_ahead(), player.layers,
                   player.layer_count));
  text(fmt::format("memory {} of {}", human_bytes(stream.memory_bytes),
                   human_bytes(playback.memory_budget())));
  for (const std::string& notice : state.notices) text(notice);
  ImGui::End();
}

// Draws a bar over the full width. Dragging in it seeks.
void draw_timeline(Playback& playback) {
  const double duration = std::max(playback.duration(), 1e-9);
  const float height = ImGui::GetFrameHeight();
  const ImVec2 corner = ImGui::GetCursorScreenPos();
  const float width = std::max(ImGui::GetContentRegionAvail().x, 1.0f);
  ImGui::InvisibleButton("timeline", {width, height});
  if (ImGui::IsItemActive()) {
    const float share = (ImGui::GetIO().MousePos.x - corner.x) / width;
    playback.seek(duration * static_cast<double>(std::clamp(share, 0.0f, 1.0f)));
  }
  const auto x_of = [&](double seconds) {
    return corner.x + width * static_cast<float>(std::clamp(seconds / duration, 0.0, 1.0));
  };
  const float middle = corner.y + 0.5f * height;
  ImDrawList& list = *ImGui::GetWindowDrawList();
  const auto bar = [&](double from, double to, float half, ImU32 colour) {
    list.AddRectFilled({x_of(from), middle - half}, {x_of(to), middle + half}, colour);
  };
  bar(0, duration, 3, kTrack);
  for (const stgs_time_range& range : playback.buffered()) {
    bar(range.begin, range.end, 3, kBuffered);
  }
  const double now = playback.seconds();
  bar(0, now, 1.5f, kPlayed);
  list.AddCircleFilled({x_of(now), middle}, 0.3f * height, kHandle);
}

void draw_controls(Playback& playback, Size size) {
  const ImGuiStyle& style = ImGui::GetStyle();
  const float height =
      2 * ImGui::GetFrameHeight() + style.ItemSpacing.y + 2 * style.WindowPadding.y;
  ImGui::SetNextWindowPos({0, ImGui::GetIO().DisplaySize.y - height});
  ImGui::SetNextWindowSize({ImGui::GetIO().DisplaySize.x, height});
  ImGui::SetNextWindowBgAlpha(0.6f);
  ImGui::Begin("controls", nullptr, kBare);
  draw_timeline(playback);
  if (ImGui::Button("<")) playback.step(-1);
  ImGui::SameLine();
  // A fixed width, so that the buttons do not move under the mouse.
  if (ImGui::Button(playback.is_playing() ? "pause" : "play", {6 * ImGui::GetFontSize(), 0})) {
    playback.toggle_pause();
  }
  ImGui::SameLine();
  if (ImGui::Button(">")) playback.step(1);
  ImGui::SameLine();
  if (ImGui::Button("-")) playback.change_rate(-1);
  ImGui::SameLine();
  text(fmt::format("{:>5.2f}x", playback.rate()));
  ImGui::SameLine();
  if (ImGui::Button("+")) playback.change_rate(1);
  ImGui::SameLine();
  bool loop = playback.loops();
  if (ImGui::Checkbox("loop", &loop)) playback.toggle_loop();
  ImGui::SameLine();
  std::string where =
      fmt::format("{:.2f} / {:.2f} s  frame {}  {}", playback.seconds(), playback.duration(),
                  playback.frame(), name_of(playback.status().state));
  if (size.width > 900) where += "   drag: orbit  wheel: zoom  WASD: fly  F1: hide";
  text(where);
  ImGui::End();
}

}  // namespace

void draw_overlay(Playback& playback, const OverlayState& state) {
  draw_statistics(playback, state);
  draw_controls(playback, state.size);
}

void draw_opening(const std::string& file) {
  const ImVec2 size = ImGui::GetIO().DisplaySize;
  ImGui::SetNextWindowPos({0.5f * size.x, 0.5f * size.y}, ImGuiCond_Always, {0.5f, 0.5f});
  ImGui::Begin("opening", nullptr,
               kBare | ImGuiWindowFlags_AlwaysAutoResize | ImGuiWindowFlags_NoInputs);
  text("opening " + file);
  ImGui::End();
}

}  // namespace stgs::tools
