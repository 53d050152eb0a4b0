// SPDX-License-Identifier: Apache-2.0
// The scene of a file: its intact tiers, and notes for everything else.
#include "interchange/stgs1/stgs1.h"

#include <algorithm>
#include <exception>
#include <set>

#include "interchange/import.h"
#include "interchange/stgs1/file.h"

namespace stgs {
namespace stgs1 {
namespace {

// Returns whether a part of the file is damaged or of a later version, and may be omitted.
bool is_of_the_file(const Status& status, const ImportMemory& memory) {
  return !memory.has_refused() && is_damage(status.code());
}

class SceneBuilder {
 public:
  SceneBuilder(File& file, ConversionNotes* notes) : file_(file), notes_(notes) {}

  Result<Scene> build() {
    for (const auto* list : {&file_.damage, &file_.notes}) {
      for (const std::string& text : *list) note(notes_, text);
    }
    scene_.metadata = file_.metadata;
    scene_.parts = file_.parts;
    scene_.gaussians.sh_degree = file_.degree;
    STGS_TRY(allocate());
    STGS_TRY(add_importance());
    STGS_TRY(add_tiers());
    if (!importance_.value.empty()) {
      importance_.value.resize(scene_.gaussians.size());
      scene_.importance = std::move(importance_.value);
    }
    STGS_TRY(count_omitted(file_));
    for (const auto& [name, all] : file_.omitted) {
      note(notes_, fmt::format("omitted {}, which a scene cannot represent ({} {}, {} bytes)", name,
                               all.records, all.records == 1 ? "record" : "records", all.bytes));
    }
    const ScenePart complete = {
        0, static_cast<double>(scene_.metadata.frames), scene_.gaussians.size(), {}};
    if (scene_.parts == std::vector<ScenePart>{complete}) scene_.parts.clear();
    return std::move(scene_);
  }

 private:
  // Allocates the primitives of a complete file. Those of a truncated one are allocated as they are
  // decoded.
  Status allocate() {
    STGS_ASSIGN(Lease lease, file_.memory.take_set(file_.primitives, file_.degree));
    if (file_.end > file_.source.size()) return {};
    scene_.gaussians.reserve(static_cast<std::size_t>(file_.primitives));
    lease_ = std::move(lease);
    return {};
  }

  Status add_importance() {
    Result<Charged<std::vector<float>>> values = read_importance(file_);
    if (values.ok()) {
      importance_ = std::move(values).value();
      Result<std::optional<Quantisation>> steps = read_steps(file_);
      if (steps.ok()) scene_.quantisation = *steps;
      return steps.ok() || is_of_the_file(steps.status(), file_.memory) ? Status() : steps.status();
    }
    if (!is_of_the_file(values.status(), file_.memory)) return values.status();
    note(notes_, "omitted the importance: " + values.status().message());
    return {};
  }

  // Appends the intact tiers.
  Status add_tiers() {
    Status reason;  // of the first omitted tier
    std::set<std::uint16_t> attributes;
    std::uint64_t first = 0;  // primitive
    for (std::size_t i = 0; i < file_.tiers.size(); ++i) {
      const Tier& tier = file_.tiers[i];
      Status sh_status;
      std::vector<std::uint16_t> skipped;
      const Result<Charged<Gaussians4D>> set = decode_tier(file_, tier, sh_status, skipped);
      if (set.ok()) {
        STGS_TRY(append(set->value, first));
        if (!sh_status.ok()) {
          if (!is_of_the_file(sh_status, file_.memory)) return sh_status;
          note(notes_, fmt::format("omitted the SH of segment {}: {}", i, sh_status.message()));
        }
      } else {
        if (!is_of_the_file(set.status(), file_.memory)) return set.status();
        const std::string& why = set.status().message();
        if (reason.ok()) reason = {set.status().code(), fmt::format("segment {}: {}", i, why)};
        note(notes_, fmt::format("omitted segment {} ({} {}): {}", i, tier.primitives,
                                 tier.primitives == 1 ? "primitive" : "primitives", why));
        scene_.parts[tier.part].primitives -= tier.primitives;
      }
      attributes.insert(skipped.begin(), skipped.end());
      first += tier.primitives;
    }
    for (const std::uint16_t attribute : attributes) {
      note(notes_,
           fmt::format("omitted the attribute {:#x}, which a scene cannot represent", attribute));
    }
    return scene_.gaussians.size() == 0 ? reason : Status();
  }

  Status append(const Gaussians4D& set, std::uint64_t first) {
    Gaussians4D& all = scene_.gaussians;
    STGS_TRY(file_.memory.reserve(all, lease_, all.size() + std::uint64_t{set.size()}));
    all.append(set);
    if (importance_.value.empty()) return {};
    // In place: tiers that are omitted leave gaps, so that nothing moves to a later index.
    const auto begin = importance_.value.begin() + static_cast<std::ptrdiff_t>(first);
    const auto to =
        importance_.value.begin() + static_cast<std::ptrdiff_t>(all.size() - set.size());
    std::copy(begin, begin + static_cast<std::ptrdiff_t>(set.size()), to);
    return {};
  }

  File& file_;
  ConversionNotes* notes_;
  Scene scene_;
  Lease lease_;                             // of its primitives
  Charged<std::vector<float>> importance_;  // of all primitives of the index; then of the scene
};

Result<Scene> read(const ByteSource& source, const ReadLimits& limits, ConversionNotes* notes) {
  ImportMemory memory(limits, source.name());
  File file{source, memory};
  STGS_TRY(open_stgs1(file));
  return SceneBuilder(file, notes).build();
}

}  // namespace
}  // namespace stgs1

bool is_stgs1(std::span<const std::uint8_t> head) {
  constexpr std::size_t kBytes = stgs1::kFileMagic.size() + 2;
  return head.size() >= kBytes &&
         std::equal(stgs1::kFileMagic.begin(), stgs1::kFileMagic.end(), head.begin()) &&
         head[kBytes - 2] == 1 && head[kBytes - 1] == 0;
}

Result<Scene> read_stgs1(const ByteSource& source, const ReadLimits& limits,
                         ConversionNotes* notes) {
  try {
    Result<Scene> scene = stgs1::read(source, limits, notes);
    if (scene.ok() || scene.status().message().starts_with(source.name())) return scene;
    return Status(scene.status().code(),
                  fmt::format("{}: {}", source.name(), scene.status().message()));
  } catch (const std::exception& e) {
    return Status(code_of(e), fmt::format("{}: {}", source.name(), e.what()));
  }
}

}  // namespace stgs
