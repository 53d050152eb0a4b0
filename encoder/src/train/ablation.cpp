// SPDX-License-Identifier: Apache-2.0
#include "train/ablation.h"

#include <algorithm>
#include <optional>
#include <string_view>
#include <utility>

#include "stgs/encoder/train.h"

namespace stgs::encoder {
namespace {

struct Named {
  const char* name;
  bool Ablation::*part;
};
constexpr Named kNamed[] = {{"representation", &Ablation::representation},
                            {"lifespan", &Ablation::lifespan},
                            {"modulation", &Ablation::modulation},
                            {"initialisation", &Ablation::initialisation}};
constexpr const char* kDensificationName = "densification";

// Disables a part; returns false if it already was, nullopt for an unknown name.
std::optional<bool> disable(Ablation& ablation, std::string_view name) {
  if (name == kDensificationName)
    return std::exchange(ablation.densification, Densification::kPlain) == Densification::kScored;
  for (const Named& named : kNamed) {
    if (name == named.name) return std::exchange(ablation.*named.part, false);
  }
  return std::nullopt;
}

}  // namespace

std::vector<std::string> ablation_names() {
  std::vector<std::string> names;
  for (const Named& named : kNamed) names.emplace_back(named.name);
  names.emplace_back(kDensificationName);
  return names;
}

std::vector<std::string> Ablation::names() const {
  std::vector<std::string> names;
  for (const Named& named : kNamed) {
    if (!(this->*named.part)) names.emplace_back(named.name);
  }
  if (densification != Densification::kScored) names.emplace_back(kDensificationName);
  return names;
}

Result<Ablation> Ablation::from_names(const std::string& names) {
  Ablation ablation;
  std::string_view left = names;
  while (!left.empty()) {
    const std::string_view name = left.substr(0, left.find(','));
    left.remove_prefix(std::min(left.size(), name.size() + 1));
    const std::optional<bool> disabled = disable(ablation, name);
    if (!disabled) {
      return usage_error("--ablate: unknown part '{}'; use one of: {}", name,
                         fmt::join(ablation_names(), ", "));
    }
    if (!*disabled) return usage_error("--ablate: '{}' is given twice; remove one", name);
  }
  if (!ablation.representation) {
    if (!ablation.lifespan || !ablation.modulation) {
      return usage_error("--ablate: {} has no effect together with representation; remove it",
                         ablation.lifespan ? "modulation" : "lifespan");
    }
    ablation.lifespan = ablation.modulation = false;
  }
  return ablation;
}

}  // namespace stgs::encoder
