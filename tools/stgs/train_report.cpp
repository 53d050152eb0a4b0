// SPDX-License-Identifier: Apache-2.0
#include "train_report.h"

#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "output_folder.h"
#include "stgs/encoder/report_page.h"
#include "stgs/encoder/training_log.h"
#include "stgs/format/parallel.h"
#include "stgs/format/scene_statistics.h"
#include "train_renders.h"

namespace stgs::tools {
namespace {

using Rows = std::vector<std::pair<std::string, std::string>>;

// Returns the value of the first line that starts with `key`, without quotes; "" if there is none.
std::string value_in(const char* path, const std::string& key) {
  std::ifstream file(path);
  for (std::string line; std::getline(file, line);) {
    if (line.rfind(key, 0) != 0) continue;
    const std::size_t from = line.find_first_not_of("\t =:\"", key.size());
    if (from == std::string::npos) return "";
    return line.substr(from, line.find_last_not_of("\" ") + 1 - from);
  }
  return "";
}

Rows machine(const encoder::TrainReport& report) {
  const auto memory = static_cast<std::uint64_t>(::sysconf(_SC_PHYS_PAGES)) *
                      static_cast<std::uint64_t>(::sysconf(_SC_PAGESIZE));
  return {{"backend", report.backend},
          {"CPU", value_in("/proc/cpuinfo", "model name")},
          {"threads", fmt::format("{}", concurrency())},
          {"memory", human_bytes(memory)},
          {"system", value_in("/etc/os-release", "PRETTY_NAME")},
          {"program", "stgs " STGS_VERSION}};
}

std::string perceptual(const encoder::TrainReport& report) {
  if (!report.perceptual) return "disabled";
  return fmt::format("LPIPS ({}{}), weights from {}", report.perceptual->network,
                     report.perceptual->linear ? "" : ", uniform channel weights",
                     report.perceptual->weights);
}

Rows outcome(const TrainReportInput& input, const SceneStatistics& statistics) {
  const encoder::TrainReport& report = input.report;
  Rows rows = {
      {"scene", input.output},
      {"capture", fmt::format("{}: {}, {}", input.capture.folder,
                              plural(std::ssize(input.capture.cameras), "camera"),
                              plural(input.capture.frames, "frame"))},
      {"steps", fmt::format("{}", report.iterations)},
      {"seconds", fmt::format("{:.1f}", report.seconds)},
      {"primitives", fmt::format("{}", report.primitives)},
      {"loss", fmt::format("{:.5f}", report.final_loss)},
      {"static primitives",
       fmt::format("{:.1f} %: visible in every frame, moving at most {:.3g} scene units over the "
                   "clip",
                   100 * statistics.static_share(), statistics.static_bound)},
      {"perceptual loss", perceptual(report)},
      {"peak memory", human_bytes(report.peak_memory)},
      {"decoded frames",
       fmt::format("peak {}, {}", human_bytes(report.frames.peak),
                   report.frames.resident ? "all in memory" : "others decoded on demand")}};
  if (report.held_out) {
    rows.emplace_back(
        "held-out views",
        fmt::format("psnr {:.2f} dB, psnr_cc {:.2f} dB, mean of {} images", report.held_out->psnr,
                    report.held_out->psnr_cc, report.held_out->images));
  }
  return rows;
}

Rows refined(const encoder::TrainReport& report) {
  Rows rows;
  for (const encoder::RefinedCamera& camera : report.cameras) {
    rows.emplace_back(
        camera.camera.name,
        fmt::format("{:.2f} pixels: {:.2f} degrees, {:.2f} % of the distance, {:.2f} "
                    "% of the focal length; {:.2f} pixels of distortion and {:.0f} % of the "
                    "brightness in the corners; {:.3f} frames later",
                    camera.pixels, camera.degrees, 100 * camera.shift, 100 * (camera.zoom - 1),
                    camera.corner_pixels, 100 * camera.corner_brightness, camera.time_shift));
  }
  return rows;
}

// Adds every curve twice: over iterations and over seconds.
void add_curves(const encoder::TrainingLog& log, bool with_perceptual, encoder::ReportPage& page) {
  for (const bool by_time : {false, true}) {
    const std::string x_label = by_time ? "seconds" : "iteration";
    const auto x = [by_time](const auto& line) {
      return by_time ? line.seconds : static_cast<double>(line.iteration);
    };
    encoder::ChartSeries loss, primitives, perceptual, psnr, psnr_cc;
    psnr.name = "psnr";
    psnr_cc.name = "psnr_cc";
    for (const encoder::LoggedStep& step : log.steps) {
      loss.points.emplace_back(x(step), step.loss);
      primitives.points.emplace_back(x(step), static_cast<double>(step.primitives));
      perceptual.points.emplace_back(x(step), step.perceptual);
    }
    for (const encoder::LoggedEvaluation& measure : log.evaluations) {
      psnr.points.emplace_back(x(measure), measure.score.psnr);
      psnr_cc.points.emplace_back(x(measure), measure.score.psnr_cc);
    }
    page.chart({"Loss, running mean", x_label, {loss}});
    page.chart({"Held-out PSNR, dB", x_label, {psnr, psnr_cc}});
    page.chart({"Primitives", x_label, {primitives}});
    if (with_perceptual) page.chart({"Perceptual loss", x_label, {perceptual}});
  }
}

void add_statistics(const SceneStatistics& statistics, encoder::ReportPage& page) {
  auto lifespans = encoder::histogram_bars(statistics.lifespans);
  lifespans.emplace_back("whole clip", static_cast<double>(statistics.whole_clip));
  page.bars({"Primitives by lifespan, seconds", lifespans});
  page.bars(
      {"Primitives by speed, scene units per second", encoder::histogram_bars(statistics.speeds)});
}

}  // namespace

Status write_train_report(const std::string& folder, const TrainReportInput& input,
                          Session& session) {
  STGS_ASSIGN(const encoder::TrainingLog log, encoder::read_training_log(input.settings.log_path));
  const SceneStatistics statistics = scene_statistics(input.scene);
  encoder::ReportPage page("Trained scene");
  page.code(session.command);
  page.table(outcome(input, statistics));
  page.heading("Training");
  add_curves(log, input.report.perceptual.has_value(), page);
  OutputFolder files(folder, session.log_sink());
  STGS_TRY(add_turntable(input, session, files, page));
  STGS_TRY(add_renders(input, files, page));
  if (!input.report.cameras.empty()) {
    page.heading("Refined cameras");
    page.table(refined(input.report));
  }
  page.heading("Lifespans and motion");
  page.paragraph(
      fmt::format("The lifespan of a primitive is the time during which its opacity is at least "
                  "1/255. {} of {} "
                  "primitives are never visible.",
                  statistics.never_visible, statistics.primitives));
  add_statistics(statistics, page);
  page.heading("Machine");
  page.table(machine(input.report));
  page.heading("Hyper-parameters");
  Rows parameters = input.report.parameters;
  parameters.insert(parameters.begin(), {{"preset", input.settings.preset},
                                         {"method", input.settings.method},
                                         {"ablate", input.settings.ablate},
                                         {"seed", fmt::format("{}", input.settings.seed)}});
  page.table(parameters);
  STGS_ASSIGN(const std::string index, files.add("index.html"));
  STGS_TRY(page.write(std::filesystem::path(index).parent_path()));
  return files.commit();
}

}  // namespace stgs::tools
