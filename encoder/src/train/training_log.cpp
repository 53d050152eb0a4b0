// SPDX-License-Identifier: Apache-2.0
#include "stgs/encoder/training_log.h"

#include <filesystem>
#include <nlohmann/json.hpp>
#include <span>
#include <string_view>
#include <system_error>

#include "stgs/format/byte_source.h"
#include "stgs/format/json_text.h"
#include "train/log_writer.h"

namespace stgs::encoder {
namespace {

using Json = nlohmann::ordered_json;

Json to_json(const LoggedStep& step) {
  return {{"iteration", step.iteration},
          {"seconds", step.seconds},
          {"loss", step.loss},
          {"l1", step.l1},
          {"ssim", step.ssim},
          {"normal", step.normal},
          {"perceptual", step.perceptual},
          {"primitives", step.primitives},
          {"visible", step.visible}};
}

Json to_json(const LoggedEvaluation& evaluation) {
  return {{"iteration", evaluation.iteration},
          {"seconds", evaluation.seconds},
          {"held_out",
           {{"psnr", evaluation.score.psnr},
            {"psnr_cc", evaluation.score.psnr_cc},
            {"images", evaluation.score.images}}}};
}

void add_line(const nlohmann::json& json, TrainingLog& log) {
  const auto iteration = json.at("iteration").get<std::uint64_t>();
  const auto seconds = json.at("seconds").get<double>();
  if (const auto held_out = json.find("held_out"); held_out != json.end()) {
    const HeldOutScore score{held_out->at("psnr").get<double>(),
                             held_out->at("psnr_cc").get<double>(),
                             held_out->at("images").get<int>()};
    log.evaluations.push_back({iteration, seconds, score});
    return;
  }
  log.steps.push_back(
      {iteration, seconds, json.at("loss").get<double>(), json.at("l1").get<double>(),
       json.at("ssim").get<double>(), json.value("normal", 0.0), json.value("perceptual", 0.0),
       json.at("primitives").get<std::uint64_t>(), json.at("visible").get<std::uint64_t>()});
}

std::span<const std::uint8_t> bytes_of(const std::string& text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

Result<std::string> read_text(const std::string& path) {
  STGS_ASSIGN(const std::unique_ptr<ByteSource> source, open_file(path));
  std::vector<std::uint8_t> bytes(source->size());
  STGS_TRY(source->read(0, bytes));
  return std::string(bytes.begin(), bytes.end());
}

// Calls visit(json, line) for every complete line; `line` includes its end.
template <typename Visit>
Status for_each_line(const std::string& path, std::string_view text, Visit visit) {
  for (int number = 1;; ++number) {
    const std::size_t end = text.find('\n');
    if (end == std::string_view::npos) return {};
    STGS_TRY(check_json_nesting(text.substr(0, end), fmt::format("{}, line {}", path, number)));
    try {
      visit(nlohmann::json::parse(text.substr(0, end)), text.substr(0, end + 1));
    } catch (const nlohmann::json::exception&) {
      return invalid_file("{}, line {}: not a training log entry", path, number);
    }
    text.remove_prefix(end + 1);
  }
}

}  // namespace

Result<TrainingLog> read_training_log(const std::string& path) {
  STGS_ASSIGN(const std::string text, read_text(path));
  TrainingLog log;
  STGS_TRY(for_each_line(
      path, text, [&](const nlohmann::json& json, std::string_view) { add_line(json, log); }));
  return log;
}

Status LogWriter::open(const std::string& path, std::uint64_t resumed) {
  std::string retained;
  std::error_code none;
  if (resumed > 0 && std::filesystem::is_regular_file(path, none)) {
    STGS_ASSIGN(const std::string text, read_text(path));
    STGS_TRY(for_each_line(path, text, [&](const nlohmann::json& json, std::string_view line) {
      if (json.at("iteration").get<std::uint64_t>() <= resumed) retained += line;
    }));
  }
  STGS_TRY(file_.open(path));
  STGS_TRY(file_.write(bytes_of(retained)));
  STGS_TRY(file_.publish());
  is_open_ = true;
  return {};
}

void LogWriter::write(const LoggedStep& step) {
  write_line(to_json(step).dump() + '\n');
}

void LogWriter::write(const LoggedEvaluation& evaluation) {
  write_line(to_json(evaluation).dump() + '\n');
}

void LogWriter::write_line(const std::string& line) {
  if (is_open_ && status_.ok()) status_ = file_.write(bytes_of(line));
}

}  // namespace stgs::encoder
