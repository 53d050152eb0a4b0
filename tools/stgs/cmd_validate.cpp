// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "command.h"
#include "end_after_signal.h"
#include "error_report.h"
#include "memory_option.h"
#include "printable.h"
#include "scene_input.h"
#include "stgs/format/scene_file.h"

namespace stgs::tools {
namespace {

constexpr int kUnreadable = 100;  // spec/conformance.md, 2

struct Verdict {
  std::string name;
  Status unreadable;  // set if the file could not be read
  std::vector<Issue> issues;

  int errors() const {
    return static_cast<int>(
        std::count_if(issues.begin(), issues.end(), [](const Issue& i) { return i.error; }));
  }
  // Returns whether reading has failed, and no error is one of the file.
  bool is_unread() const {
    return std::all_of(issues.begin(), issues.end(),
                       [](const Issue& i) { return !i.error || i.number == kUnreadable; });
  }
  // States the number of errors, at least one, and the first of them unless the report on standard
  // output lists them as text.
  Status error(bool is_listed) const {
    const Status status = description(is_listed);
    return is_unread() ? Status(StatusCode::kIo, status.message()) : status;
  }
  Status description(bool is_listed) const {
    const std::string count = plural(errors(), "error");
    if (is_listed) return invalid_file("{}: {}", name, count);
    const Issue& first =
        *std::find_if(issues.begin(), issues.end(), [](const Issue& i) { return i.error; });
    return invalid_file("{}: {}{}: {} (byte {}, issue {})", name, count,
                        errors() > 1 ? ", first" : "", first.message, first.offset, first.number);
  }
  bool valid() const { return unreadable.ok() && errors() == 0; }
};

Verdict validate_file(Session& session, const std::string& path, const ReadLimits& limits) {
  Verdict verdict;
  verdict.name = display_name(path);
  auto source = open_source(session, path, limits.max_memory);
  if (!source.ok()) {
    verdict.unreadable = source.status();
    return verdict;
  }
  auto issues = validate_scene(**source, limits);
  if (issues.ok()) {
    verdict.issues = std::move(issues).value();
    for (Issue& issue : verdict.issues) issue.message = with_url_option(std::move(issue.message));
  } else {
    verdict.unreadable = issues.status();
  }
  return verdict;
}

Json to_json(const std::vector<Verdict>& verdicts) {
  Json files = Json::array();
  bool all = true;
  for (const Verdict& verdict : verdicts) {
    Json issues = Json::array();
    for (const Issue& issue : verdict.issues) {
      issues.push_back({{"number", issue.number},
                        {"severity", issue.error ? "error" : "warning"},
                        {"offset", issue.offset},
                        {"message", issue.message}});
    }
    Json file = {{"file", verdict.name}, {"valid", verdict.valid()}, {"issues", issues}};
    if (!verdict.unreadable.ok()) file["unreadable"] = verdict.unreadable.message();
    files.push_back(file);
    all = all && verdict.valid();
  }
  return {{"valid", all}, {"files", files}};
}

std::string to_text(const std::vector<Verdict>& verdicts) {
  std::string out;
  for (const Verdict& verdict : verdicts) {
    for (const Issue& issue : verdict.issues) {
      out += fmt::format("{}: {}: {} (byte {}, issue {})\n", one_line(verdict.name),
                         issue.error ? "error" : "warning", one_line(issue.message), issue.offset,
                         issue.number);
    }
    if (verdict.valid()) out += fmt::format("{}: valid\n", one_line(verdict.name));
  }
  return out;
}

class Validate final : public Command {
 public:
  Help help() const override {
    return {"validate", "Check .stgs files against the format specification",
            "Checks structure, checksums, limits and values. Lists issues by number\n"
            "(spec/conformance.md). Exit code 3 if a file has errors, 2 if it has none but cannot "
            "be read\n"
            "completely.",
            "  stgs validate scene.stgs other.stgs"};
  }
  Shared shared() const override { return {.threads = true, .urls = true}; }
  void declare(Arguments& app) override {
    app.add_option("FILE", paths_, "The .stgs files: paths, URLs, or - for standard input")
        ->required();
    memory_.declare(app);
  }
  Status run(Session& session) override {
    const EndAfterSignal end(session, "the validation is not complete");
    std::vector<Verdict> verdicts;
    for (const std::string& path : paths_)
      verdicts.push_back(validate_file(session, path, memory_.limits()));
    STGS_TRY(session.emit(to_json(verdicts), to_text(verdicts)));
    // The status of one file becomes that of the program, which reports it.
    auto worst = std::find_if(verdicts.begin(), verdicts.end(),
                              [](const Verdict& v) { return v.errors() > 0; });
    const auto is_unreadable = [](const Verdict& v) { return !v.unreadable.ok(); };
    if (worst == verdicts.end()) {
      worst = std::find_if(verdicts.begin(), verdicts.end(), is_unreadable);
    }
    for (auto verdict = verdicts.begin(); verdict != verdicts.end(); ++verdict) {
      if (verdict != worst && is_unreadable(*verdict)) session.report_error(verdict->unreadable);
    }
    if (worst == verdicts.end()) return {};
    return is_unreadable(*worst) ? worst->unreadable : worst->error(!session.json());
  }

 private:
  std::vector<std::string> paths_;
  MemoryOption memory_;
};

}  // namespace

std::unique_ptr<Command> make_validate() {
  return std::make_unique<Validate>();
}

}  // namespace stgs::tools
