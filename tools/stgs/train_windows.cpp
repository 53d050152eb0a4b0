// SPDX-License-Identifier: Apache-2.0
#include "train_windows.h"

#include <algorithm>
#include <filesystem>

#include "allow_outside.h"
#include "encode_options.h"
#include "options.h"
#include "output_path.h"
#include "printable.h"

namespace stgs::tools {
namespace {

// Returns the file name of a window, without its extension.
std::string name_of(const encoder::FrameSpan& span) {
  return fmt::format("{:06}-{:06}", span.begin, span.end);
}

std::string path_of(const std::string& folder, const encoder::FrameSpan& span) {
  return (std::filesystem::path(folder) / (name_of(span) + ".stgs")).string();
}

std::string checkpoint_of(const std::string& path) {
  return path + ".ckpt";
}

void remove_checkpoint(const std::string& path) {
  std::error_code ignored;
  std::filesystem::remove(checkpoint_of(path), ignored);
}

// Returns the scene files of a folder, sorted by name; none if the folder does not exist.
std::vector<std::string> scenes_in(const std::string& folder) {
  std::vector<std::string> paths;
  std::error_code ignored;
  for (const auto& entry : std::filesystem::directory_iterator(folder, ignored)) {
    const std::filesystem::path& path = entry.path();
    if (path.extension() == ".stgs" && entry.is_regular_file(ignored)) paths.push_back(path);
  }
  std::sort(paths.begin(), paths.end());
  return paths;
}

// Returns whether the window has been trained with the same settings (settings_id). kUsage if
// another file is in its place.
Result<bool> is_trained(const std::string& path, const encoder::PreparedCapture& window,
                        std::uint64_t training) {
  if (!std::filesystem::exists(path)) return false;
  STGS_ASSIGN(const auto reader, SceneReader::open(path));
  CaptureWindow expected = *window.window;
  expected.training = training;
  if (reader->metadata().window == expected &&
      static_cast<int>(reader->metadata().frames) == window.frames) {
    return true;
  }
  return usage_error(
      "{}: belongs to another capture or was trained with other settings; remove it or use another "
      "folder",
      path);
}

// Trains one window. Resumes from its checkpoint if there is one, and removes it at the end.
Status train_window(const encoder::PreparedCapture& window, const std::string& path,
                    const std::string& title, const std::string& report_folder,
                    encoder::TrainSettings settings, Session& session,
                    encoder::TrainReport& report) {
  settings.checkpoint = checkpoint_of(path);
  if (std::filesystem::exists(settings.checkpoint)) settings.resume = settings.checkpoint;
  if (!report_folder.empty()) settings.log_path = report_folder + "/training.jsonl";
  const Status trained =
      train_to_file(window, path, title, report_folder, settings, session, report);
  if (!trained.ok() && interrupted() && std::filesystem::exists(settings.checkpoint)) {
    return runtime_error("{}: incomplete; run the same command again to resume from its checkpoint",
                         path);
  }
  STGS_TRY(trained);
  remove_checkpoint(path);
  return {};
}

}  // namespace

void WindowOptions::declare(Arguments& app) {
  add_allow_outside(app, allow_outside_);
  const char* group = "Long captures";
  auto* frames = app.add_option("--frames", frames_,
                                "Train only frames FIRST:END, as one window of the capture")
                     ->group(group);
  auto* window =
      app.add_option("--window", length_,
                     "Train windows of this many frames in sequence; --output is a folder. "
                     "Windows that exist there are not trained again")
          ->check(number_between(1, 1e8))
          ->excludes(frames)
          ->group(group);
  app.add_option("--overlap", overlap_, "Number of frames that consecutive windows share")
      ->check(number_between(0, 1e8))
      ->capture_default_str()
      ->needs(window)
      ->group(group);
  app.add_option("--window-index", index_,
                 "Train only window N of --window, counted from 0, for job arrays")
      ->check(number_between(0, 1e8))
      ->needs(window)
      ->group(group);
}

Result<encoder::PreparedCapture> WindowOptions::capture(const std::string& folder) const {
  STGS_ASSIGN(encoder::PreparedCapture capture,
              encoder::read_prepared_capture(folder, allow_outside_));
  if (frames_.empty()) return capture;
  STGS_ASSIGN(const FrameRange range, parse_frames(frames_, capture.frames));
  return encoder::extract_window(capture, {range.begin, range.end});
}

Result<std::vector<encoder::FrameSpan>> WindowOptions::spans(
    const encoder::PreparedCapture& capture) const {
  STGS_ASSIGN(auto spans, encoder::plan_windows(capture.frames, length_, overlap_));
  if (index_ < 0) return spans;
  if (static_cast<std::size_t>(index_) >= spans.size()) {
    return usage_error("--window-index {} is out of range; expected 0 to {}", index_,
                       spans.size() - 1);
  }
  return std::vector<encoder::FrameSpan>{spans[static_cast<std::size_t>(index_)]};
}

Status WindowOptions::check_folder(const encoder::PreparedCapture& capture,
                                   const std::string& folder) const {
  STGS_ASSIGN(const auto plan, encoder::plan_windows(capture.frames, length_, overlap_));
  STGS_ASSIGN(const encoder::PreparedCapture first, encoder::extract_window(capture, plan.front()));
  for (const std::string& path : scenes_in(folder)) {
    const auto reader = SceneReader::open(path);
    // Other files may lie here. is_trained() rejects one at the path of a window.
    if (!reader.ok() || !(*reader)->metadata().window) continue;
    const SceneMetadata& scene = (*reader)->metadata();
    const auto begin = static_cast<int>(scene.window->first_frame);
    const encoder::FrameSpan span{begin, begin + static_cast<int>(scene.frames)};
    const bool planned = std::find(plan.begin(), plan.end(), span) != plan.end();
    if (planned && scene.window->capture == first.window->capture) continue;
    return usage_error(
        "{}: is a window (frames {}:{}) of another {}; remove it or use another folder", path,
        span.begin, span.end,
        planned ? "capture" : fmt::format("plan than --window {} --overlap {}", length_, overlap_));
  }
  return {};
}

Status train_windows(const encoder::PreparedCapture& capture,
                     const std::vector<encoder::FrameSpan>& spans, const std::string& folder,
                     const std::string& title, const std::string& report_folder,
                     const encoder::TrainSettings& settings, Session& session) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) return io_error("{}: cannot create: {}", folder, error.message());
  STGS_ASSIGN(const std::uint64_t training, encoder::settings_id(settings));
  // Check all windows before training the first, which may take hours.
  for (const encoder::FrameSpan& span : spans) {
    STGS_ASSIGN(const encoder::PreparedCapture window, encoder::extract_window(capture, span));
    STGS_TRY(is_trained(path_of(folder, span), window, training).status());
  }
  Json windows = Json::array();
  std::string text;
  for (const encoder::FrameSpan& span : spans) {
    const std::string name = name_of(span), path = path_of(folder, span);
    STGS_ASSIGN(const encoder::PreparedCapture window, encoder::extract_window(capture, span));
    OutputLock lock;
    STGS_TRY(prepare_output(path, lock, session.log_sink()));
    STGS_ASSIGN(const bool done, is_trained(path, window, training));
    Json row = {{"output", path}, {"first_frame", span.begin}, {"frames", span.size()}};
    row["training"] = nullptr;
    if (done) {
      remove_checkpoint(path);  // left behind if killed after the scene was written
      text += fmt::format("{}: already trained\n", one_line(path));
    } else {
      session.log(2, fmt::format("window {} of {}: frames {}:{}", windows.size() + 1, spans.size(),
                                 span.begin, span.end));
      const std::string page =
          report_folder.empty() ? "" : fmt::format("{}/{}", report_folder, name);
      encoder::TrainReport report;
      STGS_TRY(train_window(window, path, title, page, settings, session, report));
      row["training"] = to_json(report);
      text += fmt::format("{}: {}, {} in {:.1f} s, loss {:.5f}\n", one_line(path),
                          plural(report.primitives, "primitive"), plural(report.iterations, "step"),
                          report.seconds, report.final_loss);
    }
    windows.push_back(std::move(row));
  }
  return session.emit({{"output", folder}, {"windows", windows}, {"peak_memory", peak_memory()}},
                      text);
}

}  // namespace stgs::tools
