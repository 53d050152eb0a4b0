// SPDX-License-Identifier: Apache-2.0
// Import of the temporal model keyframe-delta: composes the states of the file and evaluates them
// at the frames.
#include <algorithm>
#include <utility>

#include "interchange/fourdgs_compose.h"
#include "interchange/fourdgs_scene.h"
#include "interchange/import.h"
#include "interchange/sequence_match.h"
#include "stgs/format/math/blend.h"

namespace stgs::fourdgs {
namespace {

constexpr std::uint32_t kMaxFrames = 100'000;
constexpr double kLowestRate = 24;  // frames per second, if the file determines the rate
// Gaussians of all states and frames that a file may cost the time of: so many, and more for each
// of its bytes. A Gaussian of a state has about 20 bytes, so a state may last 5000 frames.
constexpr double kMaxWork = 1 << 24, kMaxWorkPerByte = 256;

// Evaluates states at frames and matches them. Times in seconds.
class Sampler {
 public:
  Sampler(const Contents& contents, const TimeBase& base, std::uint32_t frames,
          const SequenceTolerances& tolerances, ColourConverter colours, ImportMemory& memory)
      : contents_(contents),
        base_(base),
        frames_(frames),
        memory_(memory),
        matcher_(tolerances, memory),
        colours_(std::move(colours)) {}

  // Counts Gaussians that are read or evaluated. kUnsupported if they are too many for the file.
  Status add_work(double gaussians) {
    work_ += gaussians;
    if (work_ <= kMaxWork + kMaxWorkPerByte * static_cast<double>(contents_.bytes)) return {};
    return unsupported(
        "{}: the states at {} frames have too many Gaussians for a file of {} bytes; lower the "
        "frame rate",
        contents_.file, frames_, contents_.bytes);
  }

  // Adds the frames in [begin, end).
  Status add(const Population& state, const BodyRecord& record) {
    const auto first_after = [this](double seconds) {
      return std::min<double>(frames_, std::ceil(base_.ticks(seconds) - 1e-6));
    };
    const double end = first_after(record.end);
    if (next_ >= end) {
      ++between_frames_;
      return {};
    }
    // Before the loop: each frame takes time for all Gaussians of the state.
    STGS_TRY(add_work(static_cast<double>(state.ids.size()) * (end - next_)));
    STGS_TRY(load(state, record));
    for (; next_ < end; ++next_) {
      STGS_ASSIGN(const Charged<Gaussians4D> frame, frame_at(base_.seconds(next_), state));
      if (next_ == 0) first_frame_ = frame.value.size();
      STGS_TRY(matcher_.add(frame.value, ids_));
    }
    return {};
  }

  Scene finish(FourdgsReport& report, ConversionNotes* notes) {
    SequenceReport& sequence = report.sequence.emplace();
    Scene scene;
    scene.gaussians = matcher_.finish(sequence);
    scene.gaussians.sh_degree = contents_.header.sh_degree;
    sequence.first_frame_splats = first_frame_;
    scene.metadata.time_base = base_;
    scene.metadata.frames = frames_;
    if (invalid_ > 0) {
      note(notes, fmt::format("dropped {} Gaussians of all states with values that are not finite",
                              invalid_));
    }
    if (between_frames_ > 0) {
      note(notes, fmt::format("dropped {} states that lie between frames; raise the frame rate",
                              between_frames_));
    }
    colours_.add_notes(notes);
    finish_scene(contents_, scene, notes);
    return scene;
  }

 private:
  // Dequantises a state.
  Status load(const Population& state, const BodyRecord& record) {
    state_ = {};
    shapes_ = {};
    state_lease_ = {};
    shapes_.sh_degree = contents_.header.sh_degree;
    const std::size_t n = state.ids.size();
    STGS_ASSIGN(state_lease_, memory_.take_set(n, shapes_.sh_degree));
    STGS_ASSIGN(Lease more, memory_.take(sizeof(Gaussian) * n, "the Gaussians of a state"));
    state_lease_.merge(std::move(more));
    state_.reserve(n);
    shapes_.reserve(n);
    const std::size_t sh = state.ids.empty() ? 0 : state.sh.size() / state.ids.size();
    for (std::size_t i = 0; i < state.ids.size(); ++i) {
      const std::int32_t index = state.bins[kWindow][i];
      if (index < 0 || static_cast<std::size_t>(index) >= contents_.windows.size()) {
        return invalid_file("{}: window {} is not in the table of {} windows [byte {}]",
                            contents_.file, index, contents_.windows.size(), record.offset);
      }
      state_.push_back(
          dequantise(state, i, contents_.grid, contents_.windows[static_cast<std::size_t>(index)]));
      Gaussian& g = state_.back();
      if (!is_representable(g)) {
        ++invalid_;
        g = {};
      }
      append_shape(g, shapes_);
      colours_.append(g.rgb, state.sh.data() + sh * i, shapes_.sh);
    }
    for (FloatArray* array : {&shapes_.position, &shapes_.velocity}) array->resize(3 * n);
    for (FloatArray* array : {&shapes_.time, &shapes_.sigma, &shapes_.radius}) array->resize(n);
    return {};
  }

  Result<Charged<Gaussians4D>> frame_at(double seconds, const Population& state) {
    STGS_ASSIGN(const Lease lists, memory_.take(kListBytes * state_.size(), "the rows of a frame"));
    std::vector<std::uint32_t> rows;
    ids_.clear();
    // A frame at the beginning of a window is in it, whatever the rounding of both.
    const double instant = seconds + base_.seconds(1e-6);
    FloatArray logits;
    for (std::size_t i = 0; i < state_.size(); ++i) {
      const Gaussian& g = state_[i];
      const Window& w = contents_.windows[static_cast<std::size_t>(state.bins[kWindow][i])];
      if (!(w.begin <= instant && instant < w.end)) continue;
      const double opacity = g.opacity * visibility(g, seconds, contents_.grid.cutoff);
      if (opacity < math::kAlphaThreshold) continue;
      rows.push_back(static_cast<std::uint32_t>(i));
      ids_.push_back(state.ids[i]);
      logits.push_back(logit_of(opacity));
    }
    Charged<Gaussians4D> out;
    STGS_ASSIGN(out.lease, memory_.take_set(rows.size(), shapes_.sh_degree));
    STGS_TRY(memory_.grow(ids_lease_, sizeof(std::uint32_t) * ids_.capacity(),
                          "the identities of a frame"));
    Gaussians4D& frame = out.value;
    frame = shapes_.gather(rows);
    frame.opacity_logit = std::move(logits);
    for (std::size_t i = 0; i < rows.size(); ++i) {
      const Gaussian& g = state_[rows[i]];
      for (std::size_t c = 0; c < 3; ++c) {
        const double p = g.position[c] + g.motion[c] * (seconds - g.centre);
        frame.position[3 * i + c] = static_cast<float>(std::clamp(p, -kFarthest, kFarthest));
      }
    }
    return out;
  }

  // Rows, identities and opacities, as their lists grow.
  static constexpr std::uint64_t kListBytes = 3 * 3 * 4;
  static constexpr double kFarthest = 1e30;  // scene units
  const Contents& contents_;
  TimeBase base_;
  std::uint32_t frames_, next_ = 0;
  ImportMemory& memory_;
  Lease state_lease_, ids_lease_;
  SequenceMatcher matcher_;
  ColourConverter colours_;
  std::vector<Gaussian> state_;
  Gaussians4D shapes_;              // of the state: everything but positions and opacities
  std::vector<std::uint32_t> ids_;  // of the frame
  double work_ = 0;                 // Gaussians of all states and frames, visible or not
  std::uint64_t first_frame_ = 0, invalid_ = 0, between_frames_ = 0;
};

// The states must cover the clip without gaps.
Status check_tiling(const Contents& contents) {
  double at = 0;
  for (const BodyRecord& record : contents.body) {
    if (!record.is_chunk()) continue;
    if (record.begin != at || !(record.end >= record.begin)) {
      return invalid_file(
          "{}: states do not follow each other (from {} s to {} s, after {} s) "
          "[byte {}]",
          contents.file, record.begin, record.end, at, record.offset);
    }
    at = record.end;
  }
  if (at == contents.header.duration) return {};
  return invalid_file("{}: states end at {} s of a clip of {} s", contents.file, at,
                      contents.header.duration);
}

// Returns a frame time that divides all states evenly; 1/30 s if they differ in length.
TimeBase frame_time_of_states(const Contents& contents) {
  double length = 0;
  for (const BodyRecord& record : contents.body) {
    if (!record.is_chunk()) continue;
    const double this_length = record.end - record.begin;
    if (length == 0) length = this_length;
    if (std::abs(this_length - length) > 1e-6 * length) return {};
  }
  if (!(length > 1e-3 && length < 1e3)) return {};
  return frame_time_of(std::max(1.0, std::ceil(kLowestRate * length - 1e-6)) / length);
}

}  // namespace

Result<Scene> read_keyframes(const ByteSource& source, const Contents& contents,
                             const FourdgsSettings& settings, ImportMemory& memory,
                             FourdgsReport& report, ConversionNotes* notes) {
  STGS_TRY(check_tiling(contents));
  const TimeBase base = settings.frame_time.value_or(frame_time_of_states(contents));
  STGS_ASSIGN(const std::uint32_t frames, count_frames(contents, base, kMaxFrames));
  STGS_ASSIGN(ColourConverter colours, ColourConverter::create(contents));
  Composer composer(source, contents, memory);
  Sampler sampler(contents, base, frames, settings.tolerances.value_or(SequenceTolerances{}),
                  std::move(colours), memory);
  for (std::size_t next = 0; next < contents.body.size();) {
    const BodyRecord& record = contents.body[next];
    // Before the state is read: each takes time for all its Gaussians, also between frames.
    STGS_TRY(sampler.add_work(static_cast<double>(composer.state().ids.size()) + record.count +
                              record.births + record.deaths));
    STGS_TRY(composer.read(next));
    STGS_TRY(sampler.add(composer.state(), record));
  }
  return sampler.finish(report, notes);
}

}  // namespace stgs::fourdgs
