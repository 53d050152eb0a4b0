// SPDX-License-Identifier: Apache-2.0
// STEP, the record of Scene::quantisation (spec, annex D).
#include <cmath>

#include "container/container.h"
#include "core/bytes.h"

namespace stgs {
namespace {

void write_step(Step step, ByteWriter& out) {
  out.u8(static_cast<std::uint8_t>(step.exponent));
  out.u8(static_cast<std::uint8_t>(step.multiplier));
}

// Reads a step. Returns false if it is not one of spec 8.5.
bool read_step(ByteReader& in, Step& step) {
  step.exponent = in.i8();
  step.multiplier = in.u8();
  return step.exponent >= kMinExponent && step.exponent <= kMaxExponent && step.multiplier % 2 == 1;
}

// Calls visit(number) for each number of a quantisation besides its tiers.
template <typename Rules, typename Visit>
void each_number(Rules& rules, const Visit& visit) {
  visit(rules.quality);
  visit(rules.longest_part);
  for (auto* v : {&rules.lifespans.time, &rules.lifespans.lifespan, &rules.lifespans.motion,
                  &rules.lifespans.opacity, &rules.lifespans.edge, &rules.near_distance,
                  &rules.near_displacement}) {
    visit(*v);
  }
}

// Calls visit(step) for each step of a tier.
template <typename Tier, typename Visit>
void each_step(Tier& tier, const Visit& visit) {
  for (auto* step : {&tier.position, &tier.displacement, &tier.log_scale, &tier.rotation})
    visit(*step);
  for (auto& step : tier.sh) visit(step);
}

}  // namespace

std::vector<std::uint8_t> write_steps(const Quantisation& rules) {
  ByteWriter out;
  each_number(rules, [&out](double v) { out.f64(v); });
  for (const float v : rules.middle) out.f32(v);
  write_step(rules.opacity, out);
  out.u8(rules.graded ? 1 : 0);
  out.u8(static_cast<std::uint8_t>(rules.bounds.size()));
  for (const float v : rules.bounds) out.f32(v);
  for (const TierSteps& tier : rules.tiers)
    each_step(tier, [&out](Step step) { write_step(step, out); });
  return out.take();
}

void parse_steps(std::span<const std::uint8_t> payload, FileHead& head) {
  ByteReader in(payload);
  Quantisation rules;
  bool good = true;
  const auto number = [&](auto v) {
    good = good && std::isfinite(v);
    return v;
  };
  each_number(rules, [&](double& v) { v = number(in.f64()); });
  for (float& v : rules.middle) v = number(in.f32());
  good = read_step(in, rules.opacity) && good;
  rules.graded = in.u8() != 0;
  rules.bounds.resize(in.u8());
  for (float& v : rules.bounds) v = number(in.f32());
  rules.tiers.resize(rules.bounds.size() + 1);
  for (TierSteps& tier : rules.tiers)
    each_step(tier, [&](Step& step) { good = read_step(in, step) && good; });
  if (in.ok() && in.left() == 0 && good && is_valid(rules)) head.quantisation = std::move(rules);
}

}  // namespace stgs
