// SPDX-License-Identifier: Apache-2.0
// The program, the C interface, its header and the reference agree on every number of the settings.
#include <CLI/CLI.hpp>
#include <cmath>
#include <fstream>
#include <regex>
#include <sstream>

#include "catch.h"
#include "encode_options.h"
#include "encoder/live_parameters.h"
#include "encoder/record_parameters.h"
#include "fixtures/temporary_folder.h"
#include "parameter_reference.h"
#include "stgs/stgs_encoder.h"

namespace stgs::testing {
namespace {

std::string read(const std::string& path) {
  std::ifstream file(path);
  REQUIRE(file);
  std::stringstream text;
  text << file.rdbuf();
  return text.str();
}

template <typename Settings>
Settings defaults_of(stgs_result (*defaults)(Settings*, std::size_t)) {
  Settings settings;
  REQUIRE(defaults(&settings, sizeof settings) == STGS_OK);
  return settings;
}

// The comment of a member in a public header, on one line.
std::string comment_of(const std::string& header, const std::string& type, const char* member) {
  const std::string text = read(STGS_SDK "/include/stgs/" + header);
  const std::size_t begin = text.find("typedef struct " + type + " {"),
                    end = text.find("} " + type + ";");
  REQUIRE(end != std::string::npos);
  const std::string fields = text.substr(begin, end - begin);
  std::smatch found;
  const std::regex comment(fmt::format("\\b{};\\s*/\\*([\\s\\S]*?)\\*/", member));
  REQUIRE(std::regex_search(fields, found, comment));
  return std::regex_replace(found[1].str(), std::regex("\\s*\\n\\s*\\*\\s*"), " ");
}

// The numbers in a comment: "-3", "0.01", "10^-6", "2 * 10^8".
std::vector<double> numbers_in(const std::string& text) {
  static const std::regex number("(?:(\\d+) \\* )?(-?)10\\^(-?\\d+)|-?\\d+(?:\\.\\d+)?");
  std::vector<double> numbers;
  for (std::sregex_iterator at(text.begin(), text.end(), number), end; at != end; ++at) {
    const std::smatch& one = *at;
    if (!one[3].matched) {
      numbers.push_back(std::stod(one.str()));
      continue;
    }
    const double factor = one[1].matched ? std::stod(one[1]) : 1;
    numbers.push_back((one[2].length() > 0 ? -factor : factor) * std::pow(10, std::stod(one[3])));
  }
  return numbers;
}

bool states(const std::vector<double>& numbers, double value) {
  return std::any_of(numbers.begin(), numbers.end(), [value](double number) {
    return std::abs(number - value) <= 1e-9 * std::abs(value);
  });
}

// The comment states the range and the default.
void check_comment(const std::string& comment, const Parameter& p, double value) {
  INFO(p.name << ": " << comment);
  const std::vector<double> numbers = numbers_in(comment);
  CHECK(states(numbers, p.max));
  CHECK((states(numbers, p.min) || comment.find("up to") != std::string::npos));
  const std::size_t at = comment.find("default ");
  if (p.zero != nullptr) {
    CHECK(value == 0);
    CHECK(comment.find("0 (default)") != std::string::npos);
  } else {
    REQUIRE(at != std::string::npos);
    CHECK(numbers_in(comment.substr(at)).at(0) == value);
  }
}

// The C struct has the defaults of the C++ one, and the header states them with the ranges.
template <typename Table, typename Settings, typename CSettings>
void check_c_defaults(const Settings& defaults, const CSettings& c_defaults,
                      const std::string& header, const std::string& type) {
  Table::for_each([&](const Parameter& p, auto member) {
    INFO(type << "." << p.name);
    CHECK(p.accepts(static_cast<double>(member(defaults))));
    CHECK(static_cast<double>(member(c_defaults)) == static_cast<double>(member(defaults)));
    check_comment(comment_of(header, type, p.name), p, static_cast<double>(member(defaults)));
  });
}

// A call of the C interface rejects values beyond both ends, names the range, and accepts the ends.
template <typename Table, typename CSettings, typename Call>
void check_c_ranges(const CSettings& defaults, const Call& call) {
  Table::for_each([&](const Parameter& p, auto member) {
    using Member = std::remove_reference_t<decltype(member(const_cast<CSettings&>(defaults)))>;
    const auto message_of = [&](double value) -> std::string {
      CSettings settings = defaults;
      member(settings) = static_cast<Member>(value);
      const std::string message = call(settings);
      return message.find(fmt::format("settings: {} is ", p.name)) == 0 ? message : "";
    };
    INFO(p.name);
    CHECK(message_of(p.min).empty());
    CHECK(message_of(p.max).empty());
    const std::string beyond = message_of(2 * p.max + 1);
    CHECK(beyond.find("(expected " + p.range() + ")") != std::string::npos);
    const double below = p.min > 0 ? p.min / 2 : p.min - 1;
    if (std::is_floating_point_v<Member>) CHECK(message_of(below) != "");
  });
}

// What the program makes of arguments: its settings, or nothing if it rejects them.
template <typename Options, typename Get>
auto parse(std::vector<std::string> arguments, const Get& get)
    -> std::optional<decltype(get(std::declval<Options>()))> {
  CLI::App app;
  tools::Arguments declared(app);
  Options options;
  options.declare(declared);
  std::reverse(arguments.begin(), arguments.end());
  try {
    app.parse(arguments);
  } catch (const CLI::ValidationError&) {
    return std::nullopt;
  }
  return get(options);
}

// The options have the defaults, ranges and texts of the table. `needed`: options that some need.
template <typename Table, typename Options, typename Settings, typename Get>
void check_options(const Settings& defaults, const std::vector<std::string>& needed,
                   const Get& get) {
  CLI::App app;
  tools::Arguments declared(app);
  Options declaring;
  declaring.declare(declared);
  const auto unset = parse<Options>({}, get);
  REQUIRE(unset);
  Table::for_each([&](const Parameter& p, auto member) {
    const std::string name = p.option_name();
    INFO(name);
    CHECK(member(*unset) == member(defaults));
    const CLI::Option* option = app.get_option(name);
    CHECK(option->get_description().find(p.help) == 0);
    CHECK((option->get_default_str() == fmt::format("{}", member(defaults))) ==
          (p.zero == nullptr));
    const auto with = [&](double value) {
      std::vector<std::string> arguments = needed;
      arguments.push_back(fmt::format("{}={}", name, value));
      return parse<Options>(arguments, get);
    };
    for (const double value : {p.min, p.max}) {
      const auto settings = with(value);
      REQUIRE(settings);
      CHECK(member(*settings) == value);
    }
    CHECK_FALSE(with(2 * p.max + 1));
    CHECK_FALSE(with(p.min > 0 ? p.min / 2 : p.min - 1));
  });
}

}  // namespace

TEST_CASE("the C interface has the defaults of the tables, and its headers state the ranges") {
  check_c_defaults<encoder::PrepareParameters>(encoder::PrepareSettings{},
                                               defaults_of(stgs_prepare_settings_defaults),
                                               "stgs_encoder.h", "stgs_prepare_settings");
  check_c_defaults<encoder::TrainParameters>(encoder::TrainSettings{},
                                             defaults_of(stgs_train_settings_defaults),
                                             "stgs_encoder.h", "stgs_train_settings");
  check_c_defaults<encoder::PackParameters>(encoder::PackSettings{},
                                            defaults_of(stgs_pack_settings_defaults),
                                            "stgs_encoder.h", "stgs_pack_settings");
  // A recording is written as pack writes a scene.
  const auto record = defaults_of(stgs_record_settings_defaults);
  encoder::PackSettings recorded;
  recorded.quality = WriteSettings{}.quality;
  check_c_defaults<sdk::RecordParameters>(recorded, record, "stgs_encoder_recorder.h",
                                          "stgs_record_settings");
  const auto live = defaults_of(stgs_live_settings_defaults);
  check_c_defaults<sdk::LiveParameters>(live, live, "stgs_encoder_live.h", "stgs_live_settings");
}

TEST_CASE("the C interface checks the ranges of the tables") {
  const TemporaryFolder work;
  const std::string none = work / "none", output = work / "out.stgs";
  stgs_encoder* encoder = nullptr;
  REQUIRE(stgs_encoder_create(nullptr, &encoder) == STGS_OK);
  const auto message = [&] {
    stgs_error error{};
    error.struct_size = sizeof error;
    REQUIRE(stgs_encoder_error(encoder, &error) == STGS_OK);
    return std::string(error.message);
  };
  check_c_ranges<encoder::PrepareParameters>(
      defaults_of(stgs_prepare_settings_defaults), [&](const stgs_prepare_settings& s) {
        CHECK(stgs_encoder_prepare(encoder, none.c_str(), output.c_str(), &s, nullptr) != STGS_OK);
        return message();
      });
  check_c_ranges<encoder::TrainParameters>(
      defaults_of(stgs_train_settings_defaults), [&](const stgs_train_settings& s) {
        CHECK(stgs_encoder_train(encoder, none.c_str(), output.c_str(), &s, nullptr) != STGS_OK);
        return message();
      });
  check_c_ranges<encoder::PackParameters>(
      defaults_of(stgs_pack_settings_defaults), [&](const stgs_pack_settings& s) {
        CHECK(stgs_encoder_pack(encoder, none.c_str(), output.c_str(), &s, nullptr) != STGS_OK);
        return message();
      });
  stgs_encoder_destroy(encoder);
  check_c_ranges<sdk::RecordParameters>(
      defaults_of(stgs_record_settings_defaults), [&](const stgs_record_settings& s) {
        stgs_recorder* recorder = nullptr;
        REQUIRE(stgs_recorder_create(&recorder) == STGS_OK);
        CHECK(stgs_recorder_begin(recorder, (none + "/x.stgs").c_str(), &s) != STGS_OK);
        stgs_error error{};
        error.struct_size = sizeof error;
        REQUIRE(stgs_recorder_error(recorder, &error) == STGS_OK);
        const std::string text = error.message;
        stgs_recorder_destroy(recorder);
        return text;
      });
  stgs_live_settings rig = defaults_of(stgs_live_settings_defaults);
  rig.rig = none.c_str();
  check_c_ranges<sdk::LiveParameters>(rig, [&](const stgs_live_settings& s) {
    stgs_live* live = nullptr;
    REQUIRE(stgs_live_create(&live) == STGS_OK);
    CHECK(stgs_live_start(live, (none + "/x.stgs").c_str(), &s) != STGS_OK);
    stgs_error error{};
    error.struct_size = sizeof error;
    REQUIRE(stgs_live_error(live, &error) == STGS_OK);
    const std::string text = error.message;
    stgs_live_destroy(live);
    return text;
  });
}

TEST_CASE("the program has the options of the tables") {
  using namespace tools;
#ifdef STGS_HAS_PREPARE
  check_options<encoder::PrepareParameters, PrepareOptions>(
      encoder::PrepareSettings{}, {},
      [](const PrepareOptions& options) { return *options.settings({}); });
#endif
  const TemporaryFolder work;
  check_options<encoder::TrainParameters, TrainOptions>(encoder::TrainSettings{},
                                                        {"--checkpoint", work / "run.ckpt"},
                                                        [](const TrainOptions& options) {
                                                          Session session;  // claims the checkpoint
                                                          return *options.settings(session, {}, "");
                                                        });
  check_options<encoder::PackParameters, PackOptions>(
      encoder::PackSettings{}, {"--audio", "a.opus"},
      [](const PackOptions& options) { return options.settings(); });
}

TEST_CASE("the reference lists every parameter as the tables do") {
  INFO("cmake --build BUILD --target stgs_parameter_reference writes the page");
  CHECK(read(STGS_SDK "/docs/parameters.md") == parameter_reference());
}

TEST_CASE("write the reference", "[.][write]") {
  std::ofstream(STGS_SDK "/docs/parameters.md") << parameter_reference();
}

}  // namespace stgs::testing
