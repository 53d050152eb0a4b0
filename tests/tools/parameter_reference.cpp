// SPDX-License-Identifier: Apache-2.0
#include "parameter_reference.h"

#include <algorithm>

#include "encoder/live_parameters.h"
#include "encoder/record_parameters.h"
#include "stgs/encoder/pack.h"
#include "stgs/encoder/prepare.h"
#include "stgs/encoder/train.h"
#include "stgs/stgs_encoder.h"

namespace stgs::testing {
namespace {

// A cell of a Markdown table.
std::string cell(std::string text) {
  std::string out;
  for (const char c : text) {
    if (c == '|') out += '\\';
    out += c;
  }
  return out;
}

std::string meaning(const Parameter& p) {
  const std::string unit = *p.unit == '\0' ? "" : fmt::format(", {}", p.unit);
  return cell(p.help + unit);
}

std::string range(const Parameter& p) {
  return fmt::format("{} to {}", p.min, p.max);
}

// `with_options`: the numbers have options, too.
template <typename Table, typename Settings>
std::string section(const std::string& title, const Settings& defaults, bool with_options) {
  std::string out = fmt::format("\n## {}\n\n", title);
  if (with_options) {
    out += "| option | member | range | default | meaning |\n|---|---|---|---|---|\n";
  } else {
    out += "| member | range | default | meaning |\n|---|---|---|---|\n";
  }
  Table::for_each([&](const Parameter& p, auto member) {
    const auto value = member(defaults);
    const std::string fallback =
        p.zero != nullptr && value == 0 ? fmt::format("{} (0)", p.zero) : fmt::format("{}", value);
    if (with_options) out += fmt::format("| `{}` ", p.option_name());
    out += fmt::format("| `{}` | {} | {} | {} |\n", p.name, range(p), fallback, meaning(p));
  });
  return out;
}

std::string hyper_parameters() {
  std::string out =
      "\n## Hyper-parameters\n\n"
      "`stgs train --set NAME=VALUE`, or `stgs_parameter`; `stgs train --list-parameters` prints "
      "them.\n\n"
      "| name | range | fast | default | best | meaning |\n|---|---|---|---|---|---|\n";
  const auto fast = encoder::hyper_parameters("fast"), best = encoder::hyper_parameters("best");
  const auto balanced = encoder::hyper_parameters("default");
  for (std::size_t i = 0; i < balanced.size(); ++i) {
    const Parameter& p = balanced[i].parameter;
    out += fmt::format("| `{}` | {} | {} | {} | {} | {} |\n", p.name, range(p), fast[i].value,
                       balanced[i].value, best[i].value, meaning(p));
  }
  return out;
}

}  // namespace

std::string parameter_reference() {
  stgs_record_settings record;
  if (stgs_record_settings_defaults(&record, sizeof record) != STGS_OK) return {};
  stgs_live_settings live;
  if (stgs_live_settings_defaults(&live, sizeof live) != STGS_OK) return {};
  return "# Parameters\n\n"
         "Every number in the settings of the encoder. A value of 0 has the meaning in the column "
         "\"default\" where the range excludes it. `cmake --build BUILD --target "
         "stgs_parameter_reference` writes this page from the tables that the program and the "
         "library "
         "read.\n" +
         section<encoder::PrepareParameters>("Preparing: `stgs prepare`, `stgs_prepare_settings`",
                                             encoder::PrepareSettings{}, true) +
         section<encoder::TrainParameters>("Training: `stgs train`, `stgs_train_settings`",
                                           encoder::TrainSettings{}, true) +
         section<encoder::PackParameters>("Packing: `stgs pack`, `stgs_pack_settings`",
                                          encoder::PackSettings{}, true) +
         section<sdk::LiveParameters>("Live encoding: `stgs_live_settings`", live, false) +
         section<sdk::RecordParameters>("Recording: `stgs_record_settings`", record, false) +
         hyper_parameters();
}

}  // namespace stgs::testing
