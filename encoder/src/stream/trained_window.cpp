// SPDX-License-Identifier: Apache-2.0
#include "stgs/encoder/trained_window.h"

#include <filesystem>
#include <type_traits>
#include <utility>

#include "archive.h"
#include "train/quantisation_fields.h"

namespace stgs::encoder {
namespace {

const ArchiveKind kWindow = {.magic = {'S', 'T', 'G', 'S', 'W', 'I', 'N', '1'},
                             .noun = "trained window",
                             .if_damaged = "run the same command again, which trains it again",
                             .if_other = "use one version of stgs for all processes"};

// Fields that a window has in another form.
struct Derived {
  std::uint64_t own = 0;  // primitives of the window alone
  std::vector<MemberEnd> ends;
};

// Visits the fields in file order. `Window` is const when it is written.
template <typename Window, typename Archive>
void visit(Window& window, Derived& derived, Archive& archive) {
  auto& set = window.scene.gaussians;
  archive.value(window.scene.metadata.frames);
  archive.value(set.sh_degree);
  for (auto* const values : {&set.position, &set.log_scale, &set.rotation, &set.opacity_logit,
                             &set.sh, &set.time, &set.velocity, &set.sigma, &set.radius})
    archive.array(*values);
  archive.value(derived.own);
  archive.array(derived.ends);
  archive.array(window.scene.importance);
  Quantisation steps = window.scene.quantisation.value_or(Quantisation());
  std::uint8_t has_steps = window.scene.quantisation ? 1 : 0;
  archive.value(has_steps);
  visit_quantisation(steps, archive);
  if constexpr (!std::is_const_v<Window>) {
    if (has_steps != 0) window.scene.quantisation = std::move(steps);
  }
  archive.value(window.training.iterations);
  archive.value(window.training.seconds);
  archive.value(window.training.importance_seconds);
  archive.value(window.training.primitives);
  archive.value(window.training.final_loss);
}

// Returns whether the arrays agree on the number of primitives.
bool is_consistent(const Scene& scene, std::uint64_t own) {
  const Gaussians4D& set = scene.gaussians;
  const std::size_t n = set.size();
  if (set.sh_degree < 0 || set.sh_degree > 3) return false;
  const auto coefficients = static_cast<std::size_t>(set.sh_coefficients());
  const bool same = set.position.size() == 3 * n && set.log_scale.size() == 3 * n &&
                    set.rotation.size() == 4 * n && set.sh.size() == 3 * coefficients * n &&
                    set.time.size() == n && set.velocity.size() == 3 * n && set.sigma.size() == n &&
                    set.radius.size() == n;
  return same && own <= n && scene.metadata.frames > 0 &&
         (scene.importance.empty() || scene.importance.size() == n) &&
         (!scene.quantisation || is_valid(*scene.quantisation));
}

std::string state_path(const std::string& path) {
  return path + ".state";
}

}  // namespace

Status write_trained_window(const std::string& path, const TrainedWindow& window, bool is_last) {
  Derived derived{window.scene.parts.front().primitives, window.set.ends()};
  ArchiveWriter writer(kWindow);
  visit(window, derived, writer);
  if (is_last) STGS_TRY(window.set.write(state_path(path)));
  return writer.save(path);
}

Result<TrainedWindow> read_trained_window(const std::string& path, bool is_last) {
  STGS_ASSIGN(ArchiveReader reader, ArchiveReader::open(path, kWindow));
  TrainedWindow window;
  Derived derived;
  visit(window, derived, reader);
  Scene& scene = window.scene;
  if (!reader.complete() || !is_consistent(scene, derived.own)) {
    return invalid_file("{}: damaged {} (inconsistent array sizes); {}", path, kWindow.noun,
                        kWindow.if_damaged);
  }
  const double frames = scene.metadata.frames;
  scene.parts = {{0, frames, derived.own}, {0, frames, scene.gaussians.size() - derived.own}};
  if (is_last) {
    STGS_ASSIGN(window.set, PersistentSet::read(state_path(path)));
  }
  window.set.set_ends(std::move(derived.ends));
  return window;
}

void remove_trained_window(const std::string& path) {
  std::error_code ignored;
  std::filesystem::remove(path, ignored);
  std::filesystem::remove(state_path(path), ignored);
}

}  // namespace stgs::encoder
