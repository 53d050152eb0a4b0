// SPDX-License-Identifier: Apache-2.0
#include "train/ablation.h"

#include <algorithm>
#include <string_view>

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
                            {"initialisation", &Ablation::initialisation},
                            {"densification", &Ablation::densification}};

}  // namespace

std::vector<std::string> ablation_names() {
  std::vector<std::string> names;
  for (const Named& named : kNamed) names.emplace_back(named.name);
  return names;
}

std::vector<std::string> Ablation::names() const {
  std::vector<std::string> names;
  for (const Named& named : kNamed) {
    if (!(this->*named.part)) names.emplace_back(named.name);
  }
  return names;
}

Result<Ablation> Ablation::from_names(const std::string& names) {
  Ablation ablation;
  std::string_view left = names;
  while (!left.empty()) {
    const std::string_view name = left.substr(0, left.find(','));
    left.remove_prefix(std::min(left.size(), name.size() + 1));
    const auto* named = std::find_if(std::begin(kNamed), std::end(kNamed),
                                     [name](const Named& n) { return name == n.name; });
    if (named == std::end(kNamed)) {
      return usage_error("--ablate: unknown part '{}'; use one of: {}", name,
                         fmt::join(ablation_names(), ", "));
    }
    if (!(ablation.*named->part))
      return usage_error("--ablate: '{}' is given twice; remove one", name);
    ablation.*named->part = false;
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
