// SPDX-License-Identifier: Apache-2.0
#include "command.h"
#include "end_after_signal.h"
#include "options.h"
#include "scene_file.h"
#include "scene_info.h"

namespace stgs::tools {
namespace {

class Info final : public Command {
 public:
  Help help() const override {
    return {"info", "Show the contents of .stgs files",
            "Reads only the header, the metadata and the index, so it is fast "
            "for any file size.\n"
            "Prints five lines per file: format and size; duration, frame rate "
            "and mean bit rate;\n"
            "primitives; segments, tiers and decoder level; start camera and "
            "bounds. Metadata and\n"
            "damage follow if there are any. --segments adds tables of the "
            "bytes by tier of a\n"
            "segment, layer and attribute. --lifespans reads the entire file and prints the "
            "lifespans (the time with\n"
            "O l(t) >= 1/255), the speeds, and the static primitives: visible "
            "in every frame and\n"
            "moving over the clip at most 0.001 of the radius around the "
            "median position that holds\n"
            "95 % of the primitives. In a file of several parts, the part of a "
            "primitive stands for\n"
            "the clip. With --format json, prints everything: one object for "
            "one file,\n"
            "{\"files\": [...]} for several.",
            "  stgs info scene.stgs\n"
            "  stgs info scene.stgs --segments\n"
            "  stgs info *.stgs\n"
            "  stgs info scene.stgs --lifespans --format json"};
  }
  Shared shared() const override { return {.urls = true}; }
  void declare(Arguments& app) override {
    app.add_option("FILE", locations_, "The .stgs files: paths, URLs, or - for standard input")
        ->required();
    app.add_option("--memory", memory_, "Memory for reading a file, for example 512M or 8G")
        ->check(accepted_by<parse_memory>)
        ->capture_default_str();
    app.add_flag("--segments", segments_,
                 "Print tables of the tiers of segments, layers and streams");
    app.add_flag("--lifespans", lifespans_,
                 "Print lifespans, speeds and the share of static primitives");
  }
  // Reports every file that can be read. Returns the first error.
  Status run(Session& session) override {
    const EndAfterSignal end(session, "the information is not complete");
    Json files = Json::array();
    std::string text;
    Status first;
    for (const std::string& location : locations_) {
      const Status status = add(session, location, files, text);
      if (status.ok()) continue;
      if (first.ok()) {
        first = status;
      } else {
        session.report_error(status);
      }
    }
    if (files.empty() && text.empty()) return first;
    STGS_TRY(session.emit(locations_.size() == 1 ? files[0] : Json{{"files", files}}, text));
    return first;
  }

 private:
  Status add(Session& session, const std::string& location, Json& files, std::string& text) const {
    STGS_ASSIGN(const std::uint64_t memory, parse_memory(memory_));
    STGS_ASSIGN(const auto file, SceneFile::open(session, location, memory));
    STGS_ASSIGN(const SceneInfo info, read_info(*file));
    std::optional<stgs_scene_statistics> statistics;
    if (lifespans_) {
      STGS_ASSIGN(statistics, read_statistics(*file));
    }
    if (session.json()) {
      files.push_back(info_json(info));
      if (statistics) files.back()["motion"] = statistics_json(*statistics);
      return {};
    }
    if (!text.empty()) text += "\n";
    text += info_text(info);
    if (segments_) text += tables_text(info);
    if (statistics) text += statistics_text(*statistics);
    return {};
  }

  std::vector<std::string> locations_;
  std::string memory_ = "4G";
  bool segments_ = false, lifespans_ = false;
};

}  // namespace

std::unique_ptr<Command> make_info() {
  return std::make_unique<Info>();
}

}  // namespace stgs::tools
