// SPDX-License-Identifier: Apache-2.0
// Reading files of format version 1.0 and 1.1. stgs1_vectors/expected.txt has for each file its
// name, the hash of its decoded data, the digest of the scene ("refused" if there is none), and the
// refused parts. The decoder of that version computed them.
#include <algorithm>
#include <sstream>

#include "catch.h"
#include "stgs1_digest.h"

using namespace stgs;
using namespace stgs::testing;

namespace {

struct Expected {
  std::string name, decoded, scene;
  std::vector<std::string> refused;
};

std::vector<Expected> expected_files() {
  std::ifstream file(std::string(STGS1_VECTORS) + "/expected.txt");
  std::vector<Expected> out;
  for (std::string line; std::getline(file, line);) {
    std::istringstream in(line);
    Expected& entry = out.emplace_back();
    in >> entry.name >> entry.decoded >> entry.scene >> std::ws;
    for (std::string part; std::getline(in, part, ',');) {
      entry.refused.push_back(part.substr(part.find_first_not_of(' ')));
    }
  }
  return out;
}

Stgs1Bytes vector_bytes(const std::string& name) {
  return stgs1_file(std::string(STGS1_VECTORS) + "/" + name + ".stgs");
}

bool has_note(const ConversionNotes& notes, const std::string& text) {
  return std::any_of(notes.begin(), notes.end(),
                     [&](const std::string& note) { return note.find(text) != std::string::npos; });
}

// A source that counts the bytes read from it.
class CountingSource : public ByteSource {
 public:
  explicit CountingSource(Stgs1Bytes bytes) : inner_(memory_source(std::move(bytes), "x.stgs")) {}
  std::uint64_t size() const override { return inner_->size(); }
  Status read(std::uint64_t offset, std::span<std::uint8_t> out) const override {
    total += out.size();
    largest = std::max<std::uint64_t>(largest, out.size());
    return inner_->read(offset, out);
  }
  const std::string& name() const override { return inner_->name(); }

  mutable std::uint64_t total = 0, largest = 0;

 private:
  std::unique_ptr<ByteSource> inner_;
};

}  // namespace

TEST_CASE("files of version 1.x decode to the bits of the decoder of that version") {
  const std::vector<Expected> files = expected_files();
  REQUIRE(files.size() >= 12);
  for (const Expected& expected : files) {
    INFO(expected.name);
    const Stgs1Bytes bytes = vector_bytes(expected.name);
    REQUIRE(is_stgs1(bytes));
    const Stgs1Description found = describe_stgs1(bytes, {});
    CHECK(found.decoded == expected.decoded);
    CHECK(found.refused == expected.refused);
    CHECK(found.is_sh_zero);
    ConversionNotes notes;
    const auto scene = read_stgs1(*memory_source(bytes, "x.stgs"), {}, &notes);
    CHECK((scene.ok() ? scene_digest(*scene) : "refused") == expected.scene);
    if (!scene.ok()) {
      CHECK(scene.status().code() == StatusCode::kInvalidFile);
      CHECK(scene.status().message().starts_with("x.stgs: "));
    } else {
      CHECK(notes.size() >= expected.refused.size());
    }
    CHECK(read_stgs1(*memory_source(bytes)).ok() == scene.ok());  // without notes
  }
}

TEST_CASE("the metadata, importance and steps of a packed scene are read") {
  const auto scene = read_stgs1(*memory_source(vector_bytes("packed")));
  REQUIRE(scene.ok());
  const SceneMetadata& metadata = scene->metadata;
  CHECK(metadata.time_base == TimeBase{1, 30});
  CHECK(metadata.frames == 60);
  CHECK(metadata.title == "random scene");
  CHECK(metadata.audio == "sound.opus");
  CHECK(metadata.audio_begin == -2.5);
  CHECK(metadata.metres_per_unit == 0.5f);
  CHECK(metadata.up[1] == -1.0f);
  CHECK(metadata.floor[1] == 1.5f);
  CHECK(metadata.background[0] == 0.25f);
  CHECK(metadata.bounds_min[0] < metadata.bounds_max[0]);
  REQUIRE(metadata.start_camera.has_value());
  CHECK(metadata.start_camera->fx == 500.0f);
  CHECK(metadata.start_camera->width == 640);
  CHECK(metadata.window == CaptureWindow{10, 100, 3, 4});
  CHECK(scene->parts.empty());
  CHECK_FALSE(scene->quantisation.has_value());

  const auto lossless = read_stgs1(*memory_source(vector_bytes("steps")));
  REQUIRE(lossless.ok());
  CHECK(lossless->gaussians.size() == 24);
  CHECK(lossless->importance.size() == 24);
  REQUIRE(lossless->quantisation.has_value());
  CHECK(lossless->quantisation->tiers.size() == lossless->quantisation->bounds.size() + 1);
}

TEST_CASE("notes number the parts that are omitted") {
  const auto notes_of = [](const char* name) {
    ConversionNotes notes;
    REQUIRE(read_stgs1(*memory_source(vector_bytes(name)), {}, &notes).ok());
    return notes;
  };
  CHECK(has_note(notes_of("damage_to_one_segment"), "omitted segment 1 (2 primitives):"));
  CHECK(has_note(notes_of("harmonics_damaged"), "the SH of segment 0:"));
  CHECK(has_note(notes_of("head_index"), "read from its copy"));
  CHECK(has_note(notes_of("fragment_damaged"), "a fragment is damaged"));
  CHECK(has_note(notes_of("truncated_in_a_segment"), "copy or download it again"));
  CHECK(has_note(notes_of("truncated_in_a_segment"), "omitted the importance"));
  CHECK(has_note(notes_of("optional_stream"), "attribute 0x8001"));
  CHECK(has_note(notes_of("private_numbers"), "further records of content 200"));
  CHECK(has_note(notes_of("private_numbers"), "record 'liGT'"));
  CHECK(notes_of("coded_degree_3").empty());
}

TEST_CASE("other versions are not files of version 1.x") {
  Stgs1Bytes bytes = vector_bytes("tiers");
  CHECK_FALSE(is_stgs1(std::span(bytes).first(9)));
  bytes[8] = 2;
  CHECK_FALSE(is_stgs1(bytes));
  const std::uint64_t sum = XXH3_64bits(bytes.data(), 32);
  for (std::size_t i = 0; i < 8; ++i) bytes[32 + i] = static_cast<std::uint8_t>(sum >> 8 * i);
  const auto scene = read_stgs1(*memory_source(bytes));
  CHECK(scene.status().code() == StatusCode::kUnsupported);
  CHECK(scene.status().message().find("2.") != std::string::npos);
}

TEST_CASE("the limits of the caller are checked before primitives are decoded") {
  const Stgs1Bytes bytes = vector_bytes("lanes_2112");
  ReadLimits limits;
  limits.max_primitives = 2111;
  CHECK(read_stgs1(*memory_source(bytes), limits).status().code() == StatusCode::kUnsupported);
  limits.max_primitives = 2112;
  CHECK(read_stgs1(*memory_source(bytes), limits).ok());
  limits.max_memory = 4 * 20 * 2112;  // its floats alone
  CHECK(read_stgs1(*memory_source(bytes), limits).status().code() == StatusCode::kUnsupported);
}

TEST_CASE("truncated files are read or refused, from the bytes that exist") {
  for (const char* name : {"tiers", "packed", "growing_closed_head"}) {
    const Stgs1Bytes all = vector_bytes(name);
    std::size_t previous = 0;
    for (std::size_t size = 0; size <= all.size(); ++size) {
      INFO(name << ": " << size << " bytes");
      const CountingSource source({all.begin(), all.begin() + static_cast<std::ptrdiff_t>(size)});
      ReadLimits limits;
      limits.max_memory = 1 << 20;
      const auto scene = read_stgs1(source, limits);
      CHECK(source.largest <= size);
      CHECK(source.total <= 16 * size + 4096);
      const std::size_t primitives = scene.ok() ? scene->gaussians.size() : 0;
      CHECK(primitives >= previous);  // more bytes, more primitives
      previous = primitives;
    }
    CHECK(previous > 0);
  }
}
