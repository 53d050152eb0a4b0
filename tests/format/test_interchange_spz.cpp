// SPDX-License-Identifier: Apache-2.0
// Reading and writing of SPZ.
#include <zlib.h>

#include <cmath>

#include "catch.h"
#include "fixtures/scene_fixture.h"
#include "stgs/format/interchange.h"
#include "stgs/format/math/blend.h"
#include "stgs/format/math/sh.h"

namespace stgs {
namespace {

using Bytes = std::vector<std::uint8_t>;

Gaussians4D fixture_set(int degree, std::size_t n = 50) {
  Gaussians4D set = testing::random_scene(n, degree, 6, 4).gaussians;
  for (float& logit : set.opacity_logit) logit = std::abs(logit);
  set_static_lifespan(set);
  return set;
}

Result<Scene> read(Bytes bytes, ConversionNotes* notes = nullptr, const ReadLimits& limits = {}) {
  return read_spz(*memory_source(std::move(bytes), "test.spz"), limits, notes);
}

Bytes gzip(const Bytes& raw) {
  z_stream stream{};
  REQUIRE(deflateInit2(&stream, 6, Z_DEFLATED, 16 + MAX_WBITS, 8, Z_DEFAULT_STRATEGY) == Z_OK);
  Bytes out(deflateBound(&stream, raw.size()));
  stream.next_in = const_cast<Bytef*>(raw.data());
  stream.avail_in = static_cast<uInt>(raw.size());
  stream.next_out = out.data();
  stream.avail_out = static_cast<uInt>(out.size());
  REQUIRE(deflate(&stream, Z_FINISH) == Z_STREAM_END);
  out.resize(stream.total_out);
  deflateEnd(&stream);
  return out;
}

void append(Bytes& out, const Bytes& more) {
  out.insert(out.end(), more.begin(), more.end());
}

Bytes old_header(std::uint8_t version, std::uint8_t count, std::uint8_t degree,
                 std::uint8_t flags = 0) {
  return {'N', 'G', 'S', 'P', version, 0, 0, 0, count, 0, 0, 0, degree, 12, flags, 0};
}

// One primitive at SPZ's (1, 2, -3), which is (1, -2, 3) here.
Bytes old_body(std::uint8_t version, std::uint8_t degree) {
  Bytes out = {0, 0x10, 0, 0, 0x20, 0, 0, 0xD0, 0xFF};  // 4096, 8192, -12288
  append(out, {51});                                    // opacity 0.2
  append(out, {255, 0, 128});                           // colour
  append(out, {160, 144, 128});                         // log scales 0, -1, -2
  if (version == 2) {
    append(out, {255, 127, 128});  // almost a half turn about x
  } else {
    append(out, {0, 0, 0, 0});  // the same; x is the largest
  }
  const std::size_t sh_count = 3 * ((degree + 1u) * (degree + 1u) - 1);
  for (std::size_t k = 0; k < sh_count; ++k) out.push_back(static_cast<std::uint8_t>(129 + k));
  return out;
}

Bytes old_file(std::uint8_t version, std::uint8_t degree) {
  Bytes raw = old_header(version, 1, degree);
  append(raw, old_body(version, degree));
  return gzip(raw);
}

void check_axes(const Gaussians4D& set) {
  CHECK(set.position == FloatArray{1, -2, 3});
  // A half turn about x is the same in both axis conventions; the sign of a quaternion is
  // arbitrary.
  CHECK(std::abs(set.rotation[1]) == Approx(1).margin(1e-3));
  CHECK(set.log_scale == FloatArray{0, -1, -2});
  CHECK(math::opacity_of(set.opacity_logit[0]) == Approx(0.2));
  CHECK(set.sh[0] == Approx(0.5 / 0.15));
  CHECK(set.sh[1] == Approx(-0.5 / 0.15));
}

}  // namespace

TEST_CASE("SPZ 4 round-trips within its quantisation steps") {
  for (int degree = 0; degree <= 3; ++degree) {
    const Gaussians4D set = fixture_set(degree);
    const auto bytes = write_spz(set);
    REQUIRE(bytes.ok());
    ConversionNotes notes;
    const Result<Scene> back = read(*bytes, &notes);
    REQUIRE(back.ok());
    CHECK(notes.empty());
    const Result<ConversionErrors> errors = conversion_errors(set, *back);
    REQUIRE(errors.ok());
    // Coordinates are below 8, so a step is 2^-13; the error is half a step per axis.
    CHECK(errors->position_max <= 0.87 / 8192);
    CHECK(errors->log_scale_max <= 0.5 / 16 + 1e-5);
    CHECK(errors->rotation_max < 0.3);
    CHECK(errors->opacity_max <= 0.5 / 255 + 1e-6);
    CHECK(errors->sh_max <= 0.0626);
    CHECK(errors->sh_rms < 0.03);
    CHECK(errors->colour_max < 0.004);
    // A second round trip changes nothing, except rotations near a rounding tie.
    const auto again = conversion_errors(back->gaussians, *read(*write_spz(back->gaussians)));
    CHECK(again->position_max == 0);
    CHECK(again->log_scale_max == 0);
    CHECK(again->opacity_max == 0);
    CHECK(again->colour_max == 0);
    CHECK(again->sh_max == 0);
    CHECK(again->rotation_max < 0.2);
  }
}

TEST_CASE("barely visible primitives stay visible after SPZ") {
  Gaussians4D set = fixture_set(0, 200);
  for (std::size_t i = 0; i < set.size(); ++i) {
    set.opacity_logit[i] = -5.5373f + 0.002f * static_cast<float>(i);  // from just above 1/255
  }
  const Scene back = *read(*write_spz(set));
  CHECK(snapshot_at(back, 0)->size() == snapshot_at(static_scene(set), 0)->size());
}

TEST_CASE("SPZ states whether splats are band-limited") {
  for (const int kernel : {math::kDilated, math::kBandLimited}) {
    ConversionNotes notes;
    const Result<Scene> back = read(*write_spz(fixture_set(1), &notes, kernel), &notes);
    REQUIRE(back.ok());
    CHECK(back->metadata.kernel == kernel);
    CHECK(notes.empty());
  }
}

TEST_CASE("SPZ preserves far positions and rejects those out of range") {
  Gaussians4D set = fixture_set(0, 3);
  set.position[0] = 100000;
  const Result<Scene> back = read(*write_spz(set));
  REQUIRE(back.ok());
  CHECK(back->gaussians.position[0] == Approx(100000).margin(1.0 / 64));
  set.position[0] = 1e8f;
  CHECK(write_spz(set).status().code() == StatusCode::kUnsupported);
  CHECK(write_spz(Gaussians4D{}).status().code() == StatusCode::kUnsupported);
}

TEST_CASE("SPZ 2 and 3 are read, and other versions are rejected") {
  for (const auto version : std::initializer_list<std::uint8_t>{2, 3}) {
    for (const auto degree : std::initializer_list<std::uint8_t>{0, 1, 3}) {
      const Result<Scene> scene = read(old_file(version, degree));
      REQUIRE(scene.ok());
      CHECK(scene->gaussians.sh_degree == degree);
      check_axes(scene->gaussians);
      if (degree == 0) continue;
      // Of degree 1, the coefficients along y and z change sign; the one along x does not.
      CHECK(scene->gaussians.sh[3] == -1.0f / 128);
      CHECK(scene->gaussians.sh[6] == -4.0f / 128);
      CHECK(scene->gaussians.sh[9] == 7.0f / 128);
    }
  }
  CHECK(read(gzip(old_header(1, 0, 0))).status().code() == StatusCode::kUnsupported);
  CHECK(read(gzip(old_header(5, 0, 0))).status().code() == StatusCode::kUnsupported);
  CHECK(read(old_header(3, 0, 0)).status().code() == StatusCode::kInvalidFile);
}

TEST_CASE("SPZ of degree 4 is truncated to degree 3 with a note") {
  ConversionNotes notes;
  const Result<Scene> scene = read(old_file(3, 4), &notes);
  REQUIRE(scene.ok());
  CHECK(scene->gaussians.sh_degree == 3);
  check_axes(scene->gaussians);
  REQUIRE(notes.size() == 1);
  CHECK_THAT(notes[0], Catch::Contains("degree 4"));
}

TEST_CASE("SPZ extensions: axes are applied, unknown ones are reported") {
  const auto with = [](const Bytes& extensions) {
    Bytes raw = old_header(3, 1, 0, 2);
    append(raw, old_body(3, 0));
    append(raw, extensions);
    return gzip(raw);
  };
  const Bytes rdf = {3, 0, 0xBE, 0xAD, 4, 0, 0, 0, 6, 0, 0, 0};
  const Result<Scene> same = read(with(rdf));
  REQUIRE(same.ok());
  CHECK(same->gaussians.position == FloatArray{1, 2, -3});
  Bytes luf = rdf;
  luf[8] = 7;
  CHECK(read(with(luf))->gaussians.position == FloatArray{-1, -2, -3});
  Bytes rotated = rdf;
  rotated[8] = 16;
  CHECK(read(with(rotated)).status().code() == StatusCode::kUnsupported);
  ConversionNotes notes;
  CHECK(read(with({1, 0, 0x34, 0x12, 2, 0, 0, 0, 9, 9}), &notes).ok());
  REQUIRE(notes.size() == 1);
  CHECK_THAT(notes[0], Catch::Contains("0x12340001"));
  CHECK(read(with({1, 0, 0x34, 0x12, 3, 0, 0, 0, 9, 9})).status().code() ==
        StatusCode::kInvalidFile);
}

TEST_CASE("an SPZ file truncated at any byte is rejected") {
  for (const Bytes& complete : {*write_spz(fixture_set(1, 4)), old_file(2, 1), old_file(3, 0)}) {
    for (std::size_t size = 0; size < complete.size(); ++size) {
      const auto cut =
          read({complete.begin(), complete.begin() + static_cast<std::ptrdiff_t>(size)});
      REQUIRE(cut.status().code() == StatusCode::kInvalidFile);
    }
  }
}

TEST_CASE("an SPZ file with a changed byte is rejected or read as a valid set") {
  for (const Bytes& complete : {*write_spz(fixture_set(1, 4)), old_file(3, 1)}) {
    for (std::size_t at = 0; at < complete.size(); ++at) {
      for (const auto flip : std::initializer_list<std::uint8_t>{0x01, 0x80, 0xFF}) {
        Bytes changed = complete;
        changed[at] ^= flip;
        const Result<Scene> scene = read(changed, nullptr, {.max_memory = 1 << 24});
        if (scene.ok()) CHECK(encode_scene(*scene, {}).ok());
      }
    }
  }
}

TEST_CASE("an SPZ header that exceeds the file is rejected") {
  Bytes many = *write_spz(fixture_set(0, 4));
  many[10] = 0x7F;  // 8 million primitives in a few hundred bytes
  CHECK(read(many).status().code() == StatusCode::kInvalidFile);
  Bytes raw = old_header(3, 0, 0);
  raw[10] = 0x7F;
  CHECK(read(gzip(raw)).status().code() == StatusCode::kInvalidFile);
  raw[11] = 0xFF;
  CHECK(read(gzip(raw)).status().code() == StatusCode::kUnsupported);  // beyond the limits
  CHECK(read(*write_spz(fixture_set(0, 4)), nullptr, {.max_primitives = 3}).status().code() ==
        StatusCode::kUnsupported);
}

}  // namespace stgs
