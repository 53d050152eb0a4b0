// SPDX-License-Identifier: Apache-2.0
#include "stgs/stgs_contents.h"

#include <algorithm>

#include "scene.h"
#include "stgs/format/damage_report.h"
#include "stgs/format/decoder_model.h"
#include "stgs/format/scene_statistics.h"
#include "structs.h"

using stgs::player::Timeline;
using stgs::sdk::guarded;
using stgs::sdk::Outcome;

namespace {

template <typename T>
std::uint32_t count_of(const std::vector<T>& list) {
  return static_cast<std::uint32_t>(list.size());
}

stgs_form form_of(stgs::SceneForm form) {
  switch (form) {
    case stgs::SceneForm::kGrowing:
      return STGS_FORM_GROWING;
    case stgs::SceneForm::kRecorded:
      return STGS_FORM_RECORDED;
    case stgs::SceneForm::kFinished:
      break;
  }
  return STGS_FORM_FINISHED;
}

stgs_contents to_c(const Timeline& timeline) {
  const stgs::SceneReader& reader = timeline.reader();
  const stgs::SceneMetadata& metadata = reader.metadata();
  const stgs::TimeBase& base = metadata.time_base;
  stgs_contents out{};
  out.struct_size = sizeof(out);
  out.form = form_of(reader.form());
  for (const stgs::SegmentInfo& segment : reader.segments()) {
    out.tiers = std::max(out.tiers, segment.tier + 1);
  }
  out.head_bytes = reader.head_bytes();
  out.incomplete_bytes = reader.incomplete_bytes();
  out.missing_bytes = reader.missing_bytes();
  out.chunk_seconds = base.seconds(reader.chunk_ticks());
  out.parts = count_of(reader.parts());
  out.segments = count_of(reader.segments());
  out.streams = count_of(reader.streams());
  out.lost_fragments = count_of(reader.lost_fragments());
  out.damaged_segments = count_of(timeline.segment_damage());
  if (const auto& window = metadata.window) {
    out.capture_id = window->capture;
    out.training_id = window->training;
    out.is_window = 1;
    out.window_first_frame = window->first_frame;
    out.capture_frames = window->capture_frames;
  }
  return out;
}

stgs_part to_c(const stgs::ScenePart& part, const stgs::TimeBase& base) {
  const stgs::TickRange displayed = part.displayed_range();
  return {sizeof(stgs_part),
          base.seconds(part.begin_ticks),
          base.seconds(part.end_ticks),
          base.seconds(displayed.begin),
          base.seconds(displayed.end),
          part.primitives};
}

stgs_segment to_c(const stgs::SegmentInfo& segment, const stgs::TimeBase& base) {
  stgs_segment out{};
  out.struct_size = sizeof(out);
  out.level = segment.level;
  out.tier = segment.tier;
  out.begin_seconds = base.seconds(segment.begin_ticks);
  out.end_seconds = base.seconds(segment.end_ticks);
  out.offset = segment.offset;
  out.bytes = segment.bytes;
  out.sh_offset = segment.sh_offset;
  out.sh_bytes = segment.sh_bytes;
  out.primitives = segment.primitives;
  out.part = segment.part;
  out.available = segment.available ? 1 : 0;
  out.sh_available = segment.sh_available ? 1 : 0;
  return out;
}

stgs_lost_fragment to_c(const stgs::LostFragment& lost, const stgs::TimeBase& base) {
  return {sizeof(stgs_lost_fragment), base.seconds(lost.range.begin), base.seconds(lost.range.end),
          lost.offset, lost.bytes};
}

stgs_decoder_needs to_c(const stgs::DecoderNeeds& needs) {
  stgs_decoder_needs out{};
  out.struct_size = sizeof(out);
  out.level = needs.level;
  out.primitives = needs.primitives;
  out.segments = needs.segments;
  out.bytes = needs.bytes;
  out.decoded_bytes = needs.decoded_bytes;
  out.ranges = needs.ranges;
  out.index_bytes = needs.index_bytes;
  out.startup_bytes = needs.startup_bytes;
  out.bits_per_second = needs.bits_per_second;
  out.primitives_per_second = needs.primitives_per_second;
  return out;
}

// Reuses the memory of `out`.
void copy_bins(const std::vector<stgs::HistogramBin>& bins, std::vector<stgs_histogram_bin>& out) {
  out.clear();
  for (const stgs::HistogramBin& bin : bins) {
    out.push_back({sizeof(stgs_histogram_bin), bin.from, bin.to, bin.count});
  }
}

// The bins belong to the scene.
stgs_scene_statistics to_c(const stgs::SceneStatistics& statistics, stgs_scene& scene) {
  copy_bins(statistics.lifespans, scene.lifespans);
  copy_bins(statistics.speeds, scene.speeds);
  stgs_scene_statistics out{};
  out.struct_size = sizeof(out);
  out.primitives = statistics.primitives;
  out.never_visible = statistics.never_visible;
  out.scene_radius = statistics.scene_radius;
  out.lifespans = scene.lifespans.data();
  out.speeds = scene.speeds.data();
  out.lifespan_bins = count_of(scene.lifespans);
  out.speed_bins = count_of(scene.speeds);
  out.whole_clip = statistics.whole_clip;
  out.median_lifespan = statistics.median_lifespan;
  out.median_speed = statistics.median_speed;
  out.static_bound = statistics.static_bound;
  out.static_primitives = statistics.static_primitives;
  out.static_share = statistics.static_share();
  out.whole_clip_drift = statistics.whole_clip_drift;
  return out;
}

// Checks the index of a function that returns one element of a list.
Outcome check_index(std::uint32_t index, std::size_t size, const char* number) {
  if (index < size) return {};
  return {STGS_ERROR_ARGUMENT,
          fmt::format("index: out of range (stgs_contents.{} is {}, got {})", number, size, index)};
}

// Implements a function that returns one element. `list` returns the elements of a timeline, `make`
// the result for one of them.
template <typename Out, typename List, typename Make>
stgs_result get_element(stgs_scene* scene, std::uint32_t index, Out* out, const char* name,
                        const char* number, const List& list, const Make& make) {
  return guarded(scene, [&]() -> Outcome {
    STGS_SDK_TRY(scene->check_open());
    STGS_SDK_TRY(stgs::sdk::check_struct(out, name));
    const auto& elements = list(*scene->timeline);
    STGS_SDK_TRY(check_index(index, elements.size(), number));
    stgs::sdk::copy_out(out, make(elements[index], scene->timeline->metadata().time_base));
    return {};
  });
}

}  // namespace

extern "C" {

stgs_result stgs_scene_get_contents(stgs_scene* scene, stgs_contents* contents) {
  return guarded(scene, [&]() -> Outcome {
    STGS_SDK_TRY(scene->check_open());
    STGS_SDK_TRY(stgs::sdk::check_struct(contents, "contents"));
    stgs::sdk::copy_out(contents, to_c(*scene->timeline));
    return {};
  });
}

stgs_result stgs_scene_get_part(stgs_scene* scene, uint32_t index, stgs_part* part) {
  return get_element(
      scene, index, part, "part", "parts",
      [](const Timeline& timeline) -> const auto& { return timeline.reader().parts(); },
      [](const stgs::ScenePart& one, const stgs::TimeBase& base) { return to_c(one, base); });
}

stgs_result stgs_scene_get_segment(stgs_scene* scene, uint32_t index, stgs_segment* segment) {
  return get_element(
      scene, index, segment, "segment", "segments",
      [](const Timeline& timeline) -> const auto& { return timeline.reader().segments(); },
      [](const stgs::SegmentInfo& one, const stgs::TimeBase& base) { return to_c(one, base); });
}

stgs_result stgs_scene_get_stream(stgs_scene* scene, uint32_t index, stgs_stream* stream) {
  return get_element(
      scene, index, stream, "stream", "streams",
      [](const Timeline& timeline) { return timeline.reader().streams(); },
      [scene](const stgs::StreamInfo& one, const stgs::TimeBase&) {
        return stgs_stream{sizeof(stgs_stream),
                           scene->intern(one.name),
                           one.bytes,
                           one.raw_bytes,
                           one.error ? double{one.error->greatest} : -1.0,
                           one.error ? double{one.error->rms} : -1.0};
      });
}

stgs_result stgs_scene_get_lost_fragment(stgs_scene* scene, uint32_t index,
                                         stgs_lost_fragment* fragment) {
  return get_element(
      scene, index, fragment, "fragment", "lost_fragments",
      [](const Timeline& timeline) -> const auto& { return timeline.reader().lost_fragments(); },
      [](const stgs::LostFragment& one, const stgs::TimeBase& base) { return to_c(one, base); });
}

stgs_result stgs_scene_get_damaged_segment(stgs_scene* scene, uint32_t index,
                                           stgs_damaged_segment* damaged) {
  return get_element(
      scene, index, damaged, "damaged", "damaged_segments",
      [](const Timeline& timeline) -> const auto& { return timeline.segment_damage(); },
      [scene](const stgs::player::SegmentDamage& one, const stgs::TimeBase&) {
        return stgs_damaged_segment{sizeof(stgs_damaged_segment), one.segment, one.sh_only ? 1 : 0,
                                    scene->intern(one.reason.message())};
      });
}

stgs_result stgs_scene_get_decoder_needs(stgs_scene* scene, stgs_decoder_needs* needs) {
  return guarded(scene, [&]() -> Outcome {
    STGS_SDK_TRY(scene->check_open());
    STGS_SDK_TRY(stgs::sdk::check_struct(needs, "needs"));
    stgs::sdk::copy_out(needs, to_c(stgs::decoder_needs(scene->timeline->reader())));
    return {};
  });
}

stgs_result stgs_scene_get_statistics(stgs_scene* scene, stgs_scene_statistics* statistics) {
  return guarded(scene, [&]() -> Outcome {
    STGS_SDK_TRY(scene->check_open());
    STGS_SDK_TRY(stgs::sdk::check_struct(statistics, "statistics"));
    if (scene->of_player) {
      return {STGS_ERROR_STATE,
              "the scene belongs to a player, which reads only what it plays; open the file as a "
              "scene of its own"};
    }
    const std::string& name = scene->timeline->name();
    stgs::DamageReport damage;
    const auto content =
        stgs::recover_scene(scene->timeline->reader(), name, damage,
                            {scene->settings.max_primitives, scene->settings.max_memory});
    if (!content.ok()) return scene->with_cancellation(content.status());
    for (const std::string& line : describe_damage(damage, content->metadata.time_base)) {
      scene->log(STGS_LOG_WARNING, fmt::format("{}: {}", name, line));
    }
    stgs::sdk::copy_out(statistics, to_c(stgs::scene_statistics(*content), *scene));
    return {};
  });
}

}  // extern "C"
