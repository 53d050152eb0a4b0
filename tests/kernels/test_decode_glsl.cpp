// SPDX-License-Identifier: Apache-2.0
// Compares spec/shaders/decode.comp with the project's decoder, on every Vulkan device. Exit code
// 77: no device found.
#include <bit>
#include <cmath>
#include <cstdio>
#include <memory>
#include <set>

#include "catch.h"
#include "codec/attributes.h"
#include "compute_cases.h"
#include "decode_units.h"
#include "fixtures/scene_fixture.h"

using namespace stgs;
using namespace stgs::testing;
using test::ComputeBuffer;

namespace {

constexpr std::uint32_t kSpirv[] = {
#include "decode.spv.inc"
};

void check(const Status& status) {
  INFO(status.message());
  REQUIRE(status.ok());
}

template <typename T>
std::span<const std::byte> bytes_of(const std::vector<T>& values) {
  return std::as_bytes(std::span(values));
}

struct ShaderResult {
  std::vector<std::uint32_t> q, damage;
};

ShaderResult run_shader(std::size_t device, ShaderBuffers buffers) {
  ShaderResult out;
  buffers.bytes.resize((buffers.bytes.size() + 3) / 4 * 4);
  out.q.resize(buffers.integers);
  out.damage.resize(buffers.units.size());
  const ComputeBuffer all[] = {{bytes_of(buffers.bytes), {}},
                               {bytes_of(buffers.lookups), {}},
                               {bytes_of(buffers.units), {}},
                               {bytes_of(buffers.streams), {}},
                               {bytes_of(buffers.tables), {}},
                               {{}, std::as_writable_bytes(std::span(out.q))},
                               {{}, std::as_writable_bytes(std::span(out.damage))}};
  REQUIRE(compute().run(device, kSpirv, all, static_cast<std::uint32_t>(buffers.units.size())) ==
          "");
  return out;
}

// A scene with one level of segments, whose colours follow the positions, so that differences are
// worth coding. `n` has a limit: lavapipe of Mesa 22.3 (Debian 12) ends all loops of an invocation,
// without an error, after 65,535 iterations in total. Mesa 25 does not.
std::vector<std::uint8_t> encode(std::size_t n, const WriteSettings& settings) {
  Scene scene = random_scene(n, 3, 60, 11);
  Gaussians4D& set = scene.gaussians;
  for (std::size_t i = 0; i < n; ++i) {
    set.time[i] = 30.0f;
    set.sigma[i] = 200.0f;
    set.opacity_logit[i] = 2.0f;
    for (std::size_t c = 0; c < 3; ++c)
      set.sh[48 * i + c] = std::sin(0.1f * set.position[3 * i + c]) + 0.2f * set.position[3 * i];
  }
  auto bytes = encode_scene(scene, settings);
  check(bytes.status());
  return std::move(*bytes);
}

std::unique_ptr<SceneReader> open(std::vector<std::uint8_t> bytes) {
  auto reader = SceneReader::open(memory_source(std::move(bytes)));
  check(reader.status());
  return std::move(*reader);
}

std::span<const RansLookup> lookups_of(const CodedRecord& record, const SceneReader& reader) {
  return record.own_tables ? std::span<const RansLookup>(record.lookups) : reader.tables();
}

// Compares the integers of a stream with the decoded floats, if its mapping is linear or float.
// Returns whether it is (spec 8.5).
bool check_floats(const CodedStream& stream, const StreamIntegers& q, const Gaussians4D& set) {
  if (stream.mapping != Mapping::kLinear && stream.mapping != Mapping::kFloat) return false;
  const AttributeView<const float> view = view_of(set, stream.attribute);
  const std::size_t n = stream.symbols;
  std::size_t far = 0;
  for (std::size_t k = 0; k < q.size(); ++k) {
    const std::size_t c = k / n;
    const std::size_t i = stream.members.empty() ? k % n : stream.members[k % n];
    const float value = view.data[i * view.stride + c];
    if (stream.mapping == Mapping::kFloat) {
      far += std::bit_cast<std::uint32_t>(value) != q[k] << stream.step.exponent;
      continue;
    }
    const double origin = stream.origin[c % 3];
    const double expected =
        origin + std::ldexp(double(stream.step.multiplier) * double(std::int32_t(q[k])),
                            stream.step.exponent);
    far += std::abs(value - expected) > std::ldexp(std::abs(expected) + std::abs(origin), -20);
  }
  CHECK(far == 0);
  return true;
}

// Counts of compared streams.
struct Compared {
  std::array<int, 4> by_prediction{};
  int segments = 0, with_floats = 0, stored = 0, blocks = 0;
};

void check_record(std::size_t device, const CodedSegment& segment, const CodedRecord& record,
                  std::span<const RansLookup> lookups, const Gaussians4D& set, Compared& compared) {
  const std::vector<RecordUnit> units = units_of(record);
  ShaderBuffers buffers;
  for (const RecordUnit& unit : units) buffers.add(unit, lookups, segment.first_key);
  const ShaderResult found = run_shader(device, buffers);
  CHECK(found.damage == std::vector<std::uint32_t>(units.size()));
  std::size_t number = 0;  // of the stream
  for (std::size_t u = 0; u < units.size(); ++u) {
    const auto expected = scalar_integers(units[u], record, lookups, segment.first_key);
    REQUIRE(expected.size() == units[u].streams.size());
    const std::size_t blocks = rans_blocks(buffers.units[u].symbols);
    compared.blocks = std::max(compared.blocks, static_cast<int>(blocks));
    compared.stored += buffers.units[u].coder == 0;
    for (std::size_t s = 0; s < expected.size(); ++s) {
      const CodedStream& stream = *units[u].streams[s];
      INFO(name_of(stream.attribute) << ", " << stream.symbols << " primitives");
      const auto* const at = found.q.data() + buffers.streams[number++].at;
      CHECK(std::equal(expected[s].begin(), expected[s].end(), at));
      ++compared.by_prediction[static_cast<std::size_t>(stream.prediction)];
      compared.with_floats += check_floats(stream, expected[s], set);
    }
  }
}

void check_scene(const std::vector<std::uint8_t>& bytes, Compared& compared) {
  const auto reader = open(bytes);
  for (std::uint32_t s = 0; s < reader->segments().size(); ++s) {
    const auto segment = reader->read(s, true);
    check(segment.status());
    const auto set = reader->decode(s, true);
    check(set.status());
    ++compared.segments;
    for (const CodedRecord& record : segment->records) {
      for (std::size_t device = 0; device < compute().devices().size(); ++device)
        check_record(device, *segment, record, lookups_of(record, *reader), *set, compared);
    }
  }
}

}  // namespace

TEST_CASE("the shader decodes the integers of every stream of quantised and lossless segments") {
  Compared all;
  WriteSettings settings;
  settings.profile = Profile::kQuantised;
  settings.tiers = 1;
  check_scene(encode(20000, settings), all);
  CHECK(all.blocks == 2);
  settings.tiers = 3;
  settings.own_layouts = true;
  check_scene(encode(3000, settings), all);
  settings.coder = SceneCoder::kBytes;
  check_scene(encode(700, settings), all);
  settings.profile = Profile::kLossless;
  settings.coder = SceneCoder::kRans;
  check_scene(encode(300, settings), all);
  for (const std::size_t n : {1, 255, 257, 8193}) {
    settings.profile = Profile::kQuantised;
    settings.tiers = 1;
    check_scene(encode(n, settings), all);
  }
  const auto& [plain, zigzag, delta, morton] = all.by_prediction;
  std::printf(
      "%d segments; streams: %d plain, %d zigzag, %d delta, %d Morton; %d compared with floats; %d "
      "stored\n",
      all.segments, plain, zigzag, delta, morton, all.with_floats, all.stored);
  CHECK((plain > 0 && zigzag > 0 && delta > 0 && morton > 0));
  CHECK(all.with_floats > 0);
  CHECK(all.stored > 0);
}

TEST_CASE("the shader rejects the groups that the decoder rejects, and no others") {
  WriteSettings settings;
  settings.profile = Profile::kQuantised;
  settings.tiers = 1;
  const auto reader = open(encode(9000, settings));
  const auto segment = reader->read(0, true);
  check(segment.status());
  std::mt19937 random(5);
  int rejected = 0, accepted = 0;
  for (const CodedRecord& record : segment->records) {
    const auto lookups = lookups_of(record, *reader);
    std::vector<RecordUnit> damaged;
    ShaderBuffers buffers;
    for (const RecordUnit& unit : units_of(record)) {
      for (int k = 0; k < 12 && unit.group != nullptr; ++k) {
        RecordUnit& other = damaged.emplace_back(unit);
        if (k % 3 == 0)
          other.bytes[random() % other.bytes.size()] ^= static_cast<std::uint8_t>(1 << k / 3);
        if (k % 3 == 1) other.bytes.resize(other.bytes.size() - 1 - random() % 3);
        if (k % 3 == 2) other.bytes.resize(other.bytes.size() + random() % 3);
        buffers.add(other, lookups, segment->first_key);
      }
    }
    for (std::size_t device = 0; device < compute().devices().size(); ++device) {
      const ShaderResult found = run_shader(device, buffers);
      for (std::size_t u = 0; u < damaged.size(); ++u) {
        const bool good = !scalar_integers(damaged[u], record, lookups, segment->first_key).empty();
        INFO("unit " << u << ", " << damaged[u].bytes.size() << " bytes");
        CHECK((found.damage[u] == 0) == good);
        ++(good ? accepted : rejected);
      }
    }
  }
  std::printf("damaged units: %d rejected, %d accepted\n", rejected, accepted);
  CHECK(rejected > 0);
  CHECK(accepted > 0);
}

TEST_CASE("the shader computes with unsigned 32-bit integers alone") {
  // SPIR-V: the first word of an instruction has its number of words in the high half.
  constexpr std::uint32_t kTypeInt = 21, kTypeFloat = 22;
  // Conversions, arithmetic, comparisons and shifts. OpBitCount follows: in GLSL its result is int.
  constexpr std::uint32_t kFirst = 109, kLast = 204;
  std::set<std::uint32_t> signed_types;  // they number the members of structures
  std::size_t computations = 0;
  for (std::size_t at = 5; at < std::size(kSpirv); at += kSpirv[at] >> 16) {
    REQUIRE(kSpirv[at] >> 16 > 0);
    const std::uint32_t operation = kSpirv[at] & 0xFFFF;
    CHECK(operation != kTypeFloat);
    if (operation == kTypeInt) {
      CHECK(kSpirv[at + 2] == 32);
      if (kSpirv[at + 3] != 0) signed_types.insert(kSpirv[at + 1]);
    }
    if (operation < kFirst || operation > kLast) continue;
    CHECK(signed_types.count(kSpirv[at + 1]) == 0);
    ++computations;
  }
  CHECK(computations > 100);
}

int main(int argc, char** argv) {
  return run_compute_cases(argc, argv);
}
