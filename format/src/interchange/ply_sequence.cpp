// SPDX-License-Identifier: Apache-2.0
#include "stgs/format/ply_sequence.h"

#include <algorithm>
#include <charconv>
#include <filesystem>
#include <utility>

#include "interchange/ply.h"
#include "interchange/sequence_match.h"
#include "os/folder.h"

namespace stgs {
namespace {

namespace fs = std::filesystem;

struct FrameFile {
  std::uint64_t number = 0;  // the last one in its name; unused for a single file
  std::string path;
};

bool is_ply(const fs::path& path) {
  std::error_code error;
  return path.extension() == ".ply" && fs::is_regular_file(path, error);
}

Result<std::uint64_t> number_of(const fs::path& path) {
  const std::string stem = path.stem().string();
  const auto is_digit = [](char c) { return c >= '0' && c <= '9'; };
  const auto end = std::find_if(stem.rbegin(), stem.rend(), is_digit).base();
  const auto begin =
      std::find_if_not(std::make_reverse_iterator(end), stem.rend(), is_digit).base();
  std::uint64_t number = 0;
  const char* text = stem.data() + (begin - stem.begin());
  const auto parsed = std::from_chars(text, stem.data() + (end - stem.begin()), number);
  if (begin == end || parsed.ec != std::errc()) {
    return usage_error("{}: no frame number in the file name", path.string());
  }
  return number;
}

// Returns the frames in order. Their numbers must have equal steps, which detects missing frames.
Result<std::vector<FrameFile>> frame_files(const std::string& folder) {
  std::vector<FrameFile> files;
  STGS_ASSIGN(const std::vector<std::string> names, os::list_folder(folder));
  for (const std::string& name : names) {
    const fs::path path = fs::path(folder) / name;
    if (is_ply(path)) files.push_back({0, path.string()});
  }
  if (files.empty()) return io_error("{}: no .ply files in the folder", folder);
  if (files.size() == 1) return files;
  for (FrameFile& file : files) {
    STGS_ASSIGN(file.number, number_of(file.path));
  }
  std::sort(files.begin(), files.end(), [](const FrameFile& a, const FrameFile& b) {
    return std::pair(a.number, a.path) < std::pair(b.number, b.path);
  });
  for (std::size_t i = 1; i < files.size(); ++i) {
    const std::uint64_t step = files[i].number - files[i - 1].number;
    if (step == 0) {
      return usage_error("{}: has the same frame number as {}; remove one of them", files[i].path,
                         files[i - 1].path);
    }
    if (step != files[1].number - files[0].number) {
      return usage_error("{}: frames missing after {} (expected a step of {}, got {})",
                         files[i].path, files[i - 1].path, files[1].number - files[0].number, step);
    }
  }
  return files;
}

}  // namespace

double SequenceReport::matched() const {
  // Each primitive begins with one splat, and each splat of the first frame begins one.
  const std::uint64_t first = first_frame_splats, later = splats - first;
  return later == 0 ? 1 : 1 - static_cast<double>(primitives - first) / static_cast<double>(later);
}

bool is_ply_sequence(const std::string& folder) {
  const Result<std::vector<std::string>> names = os::list_folder(folder);
  return names.ok() &&
         std::any_of(names.value().begin(), names.value().end(),
                     [&](const std::string& name) { return is_ply(fs::path(folder) / name); });
}

Result<Scene> read_ply_sequence(const std::string& folder, const SequenceSettings& settings,
                                const ReadLimits& limits, SequenceReport* report,
                                ConversionNotes* notes) {
  STGS_ASSIGN(const std::vector<FrameFile> files, frame_files(folder));
  ImportMemory memory(limits, folder);
  SequenceMatcher matcher(settings.tolerances, memory);
  int degree = 0;
  std::uint64_t first_frame = 0;
  for (std::size_t i = 0; i < files.size(); ++i) {
    STGS_ASSIGN(const std::unique_ptr<ByteSource> source, open_file(files[i].path));
    ConversionNotes of_file;
    STGS_ASSIGN(const Charged<Scene> read, read_ply_scene(*source, memory, &of_file));
    const Gaussians4D& frame = read.value.gaussians;
    for (const std::string& text : of_file) note(notes, source->name() + ": " + text);
    if (i == 0) {
      degree = frame.sh_degree;
      first_frame = frame.size();
    } else if (frame.sh_degree != degree) {
      return invalid_file("{}: SH degree differs from the first frame (expected {}, got {})",
                          files[i].path, degree, frame.sh_degree);
    }
    STGS_TRY(matcher.add(frame));
  }
  SequenceReport done;
  Scene scene;
  scene.gaussians = matcher.finish(done);
  scene.metadata.time_base = settings.frame_time;
  scene.metadata.frames = done.frames;
  done.first_frame_splats = first_frame;
  if (report != nullptr) *report = done;
  return scene;
}

}  // namespace stgs
