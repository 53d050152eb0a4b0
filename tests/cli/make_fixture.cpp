// SPDX-License-Identifier: Apache-2.0
// Writes the inputs of the command-line tests into a folder: small scenes, files with valid
// checksums and wrong counts, and a prepared capture rendered from the scene.
//
// usage: make_fixture FOLDER
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <functional>

#include "../fixtures/copy_fixture.h"
#include "../fixtures/ftgs_fixture.h"
#include "../fixtures/scene_fixture.h"
#ifdef STGS_HAS_SOG
#include "../fixtures/sogst_fixture.h"
#endif
#include "../fixtures/fourdgs_fixture.h"
#include "../fixtures/splatv_fixture.h"
#include "container/body_plan.h"
#include "container/container.h"
#include "core/bytes.h"
#include "image_io.h"
#include "stgs/encoder/prepared_capture.h"
#include "stgs/format/output_file.h"
#include "stgs/format/raster.h"
#include "stgs/format/scene_recorder.h"

namespace stgs {
namespace {

constexpr int kWidth = 64, kHeight = 48, kFrames = 6;

Scene fixture_scene() {
  Scene scene = testing::random_scene(400, 1, kFrames, 7);
  scene.metadata.title = "fixture";
  StartCamera start;
  start.fx = start.fy = 60;
  start.cx = kWidth / 2.0f;
  start.cy = kHeight / 2.0f;
  start.width = kWidth;
  start.height = kHeight;
  scene.metadata.start_camera = start;
  // Makes the splats visible at a low resolution.
  for (float& s : scene.gaussians.log_scale) s += 1.5f;
  return scene;
}

Status write_capture(const Scene& scene, const std::string& folder) {
  encoder::PreparedCapture capture;
  capture.folder = folder;
  capture.frames = kFrames;
  capture.time_base = scene.metadata.time_base;
  capture.source = "fixture";
  capture.near_plane = scene.metadata.near_plane;
  capture.scene_centre[2] = 5;
  capture.scene_radius = 2;
  SplatFrame splats;
  RasterOutput output;
  for (const char* name : {"a", "b", "c"}) {
    encoder::Camera camera;
    camera.name = name;
    camera.width = kWidth;
    camera.height = kHeight;
    camera.fx = camera.fy = 60;
    camera.cx = kWidth / 2.0;
    camera.cy = kHeight / 2.0;
    camera.translation[0] = 0.4 * (name[0] - 'b');
    camera.test = name[0] == 'c';
    std::filesystem::create_directories(folder + "/frames/" + name);
    for (int i = 0; i < kFrames; ++i) {
      render(scene.gaussians, static_cast<float>(i), camera.pinhole(capture.near_plane), {}, splats,
             output);
      STGS_TRY(tools::write_png(capture.frame_path(camera, i), tools::to_8bit(output.colour)));
    }
    capture.cameras.push_back(camera);
  }
  std::vector<encoder::InitialPoint> points;
  for (std::size_t i = 0; i < scene.gaussians.size(); ++i) {
    const float* p = scene.gaussians.position.data() + 3 * i;
    points.push_back({{p[0], p[1], p[2]}, {128, 128, 128}, {0, 0, 0}, -1});
  }
  STGS_TRY(encoder::write_points(folder + "/points_static.ply", points));
  STGS_TRY(encoder::write_points(folder + "/points_dynamic.ply", {}));
  return encoder::write_prepared_capture(capture);
}

// Rewrites the head of a file after `change`, with valid checksums and without the head's copy.
Status write_changed_head(const std::vector<std::uint8_t>& copied, const std::string& path,
                          const std::function<void(FileHead&)>& change) {
  const std::vector<std::uint8_t> bytes = testing::without_copy(copied);
  Findings findings;
  FileHead head;
  const auto source = memory_source(bytes);
  if (!read_head(*source, {}, IndexLoading::kComplete, head, findings))
    return runtime_error("the fixture is not readable");
  const std::uint64_t old_head = head.header.head_bytes;
  change(head);
  ByteWriter layouts;
  write_layouts(*head.layouts, layouts);
  std::vector<std::uint8_t> records;
  const auto add = [&records](const std::vector<std::uint8_t>& record) {
    records.insert(records.end(), record.begin(), record.end());
  };
  add(write_record(kMetadataTag, write_metadata(head.metadata)));
  add(write_record(kLayoutTag, layouts.view()));
  add(BodyPlan(head.index, head.parts, kFrames, kHeaderBytes + records.size(), 0).index_record());
  head.header.head_bytes = static_cast<std::uint32_t>(kHeaderBytes + records.size());
  head.header.file_bytes += head.header.head_bytes - old_head;
  std::vector<std::uint8_t> out = write_header(head.header);
  out.insert(out.end(), records.begin(), records.end());
  out.insert(out.end(), bytes.begin() + static_cast<std::ptrdiff_t>(old_head), bytes.end());
  return write_file_atomically(path, out);
}

// Records the clip in two fragments (recorded.stgs), and a copy truncated in the second (cut.stgs).
Status write_recordings(const Scene& scene, const std::string& folder) {
  const std::string path = folder + "/recorded.stgs";
  RecordSettings settings;
  settings.sync = false;
  STGS_ASSIGN(const auto recorder,
              SceneRecorder::create(path, scene.metadata, scene.gaussians.sh_degree, settings));
  STGS_TRY(recorder->append(scene.gaussians, kFrames / 2));
  const std::uint64_t first = recorder->bytes();
  Gaussians4D second_half = scene.gaussians;
  for (float& t : second_half.time) t -= kFrames / 2;
  STGS_TRY(recorder->append(second_half, kFrames));
  STGS_TRY(recorder->close());
  std::filesystem::copy_file(path, folder + "/cut.stgs");
  std::filesystem::resize_file(folder + "/cut.stgs", first + 1000);
  return {};
}

// Writes a packed scene whose primitives are active for the complete clip (steady.stgs), so that
// the SH records come last in the file; the same scene without SH (steady_plain.stgs), and as an
// unclosed recording (live.stgs).
Status write_steady(const std::string& folder) {
  Scene scene = testing::random_scene(3000, 3, kFrames, 8);
  scene.metadata.start_camera = fixture_scene().metadata.start_camera;
  std::fill(scene.gaussians.sigma.begin(), scene.gaussians.sigma.end(), 50.0f);
  std::fill(scene.gaussians.radius.begin(), scene.gaussians.radius.end(), 50.0f);
  for (float& s : scene.gaussians.log_scale) s += 1.0f;
  const auto stride = static_cast<std::size_t>(3 * scene.gaussians.sh_coefficients());
  for (std::size_t i = 0; i < scene.gaussians.sh.size(); ++i) {
    if (i % stride >= 3) scene.gaussians.sh[i] *= 10;  // most of the file's bytes
  }
  WriteSettings settings;
  settings.profile = Profile::kQuantised;
  STGS_TRY(write_scene(folder + "/steady.stgs", scene, settings));
  STGS_ASSIGN(Scene plain, read_scene(folder + "/steady.stgs"));
  for (std::size_t i = 0; i < plain.gaussians.sh.size(); ++i) {
    if (i % stride >= 3) plain.gaussians.sh[i] = 0;
  }
  STGS_TRY(write_scene(folder + "/steady_plain.stgs", plain, {}));
  RecordSettings live;
  live.write = settings;
  live.sync = false;
  STGS_ASSIGN(const auto recorder,
              SceneRecorder::create(folder + "/live.stgs", scene.metadata, 3, live));
  return recorder->append(scene.gaussians, kFrames);
}

// Writes an EXR image with a NaN in green at (3, 2); writes nothing in a build without OpenEXR.
Status write_nan_image(const std::string& path) {
  tools::FloatFrame frame;
  frame.colour.reshape(16, 12, 3);
  frame.alpha.reshape(16, 12, 1);
  frame.depth.reshape(16, 12, 1);
  frame.colour.plane(1)[2 * 16 + 3] = std::nanf("");
  const Status status = tools::write_exr(path, frame);
  return status.code() == StatusCode::kNotBuilt ? Status() : status;
}

// A .4dgs of two states of one second. One Gaussian moves, one stays and one appears.
std::string states_file() {
  using namespace testing::fourdgs;
  File file;
  file.model = "keyframe-delta";
  std::vector<Gaussian> set(2);
  for (std::uint32_t i = 0; i < 2; ++i) {
    set[i].flags = 1;
    set[i].id = i;
    set[i].position[0] = static_cast<int>(4 * i);
  }
  Delta delta;
  delta.begin = 1;
  delta.end = 2;
  delta.reference = delta.keyframe = file.head().size();
  delta.updated = {set[1]};
  delta.update_streams = stream(0, 3, {2, 0, 0});
  file.body = chunk(0, 1, set.size(), streams(set, true));
  set[0].id = 7;
  delta.born = {set[0]};
  file.body += delta_chunk(delta);
  return file.bytes();
}

// Writes models in the formats of other programs.
Status write_models(const std::string& folder) {
#ifdef STGS_HAS_SOG
  testing::random_sog(30, 1, 1).write_bundle(folder + "/model.sog");
  testing::random_sog(20, 0, 2).write_folder(folder + "/chunks/0_0");
  testing::random_sog(25, 0, 3).write_folder(folder + "/chunks/0_1");
  testing::random_sogst(40, 1, 1, 4).write_bundle(folder + "/linear.sogst");
  testing::streamed(testing::random_sogst(40, 0, 2, 5)).write_bundle(folder + "/curved.sogst");
  testing::continuous_tsog(30, 1, 2, 6).write_bundle(folder + "/clip.tsog");
#endif
  const std::string ftgs = testing::ftgs_file(9).bytes();
  STGS_TRY(
      write_file_atomically(folder + "/clip.ftgs.ply",
                            {reinterpret_cast<const std::uint8_t*>(ftgs.data()), ftgs.size()}));
  std::vector<testing::SplatvRecord> records(12);
  for (std::size_t i = 0; i < records.size(); ++i) {
    records[i].position[0] = static_cast<float>(i);
    records[i].motion[3] = i % 2 == 0 ? 0.0f : 4.0f;  // coefficient of dt^2
  }
  const auto write_text = [&folder](const char* name, const std::string& text) {
    const auto* bytes = reinterpret_cast<const std::uint8_t*>(text.data());
    return write_file_atomically(folder + name, {bytes, text.size()});
  };
  STGS_TRY(write_text("/states.4dgs", states_file()));
  return write_text("/clip.splatv", testing::splatv_file(records));
}

Status write_all(const std::string& folder) {
  Scene scene = fixture_scene();
  WriteSettings settings;
  settings.chunk_seconds = 0.05;
  STGS_TRY(write_scene(folder + "/tiny.stgs", scene, settings));
  STGS_TRY(write_capture(scene, folder + "/prepared"));
  STGS_TRY(write_models(folder));
  STGS_TRY(write_recordings(scene, folder));
  STGS_ASSIGN(const auto bytes, encode_scene(scene, settings));
  STGS_TRY(write_changed_head(bytes, folder + "/huge_count.stgs", [](FileHead& head) {
    head.index.primitives += 0xFFFFFFFFull - head.index.segments[0].base.primitives;
    head.index.segments[0].base.primitives = 0xFFFFFFFF;
  }));
  STGS_TRY(write_changed_head(bytes, folder + "/huge_bytes.stgs", [](FileHead& head) {
    head.index.segments[0].base.bytes = std::uint64_t{1} << 62;
  }));
  STGS_TRY(write_changed_head(bytes, folder + "/wrong_sum.stgs",
                              [](FileHead& head) { head.index.primitives += 1; }));
  STGS_TRY(write_changed_head(bytes, folder + "/newer_major.stgs", [](FileHead& head) {
    head.header.major = kFormatMajor + 1;
    head.header.minor = 0;
  }));
  STGS_TRY(write_changed_head(bytes, folder + "/experiment.stgs", [](FileHead& head) {
    head.header.major = 0;
    head.header.minor = 6;
  }));
  STGS_TRY(write_changed_head(bytes, folder + "/wide_start.stgs", [](FileHead& head) {
    head.metadata.scene.start_camera->width = 0x80000040;
  }));
  STGS_TRY(write_changed_head(bytes, folder + "/skew_start.stgs", [](FileHead& head) {
    head.metadata.scene.start_camera->rotation[0] = 2;
  }));
  STGS_TRY(write_changed_head(bytes, folder + "/no_near.stgs",
                              [](FileHead& head) { head.metadata.scene.near_plane = 0; }));
  STGS_TRY(write_nan_image(folder + "/nan.exr"));
  settings.profile = Profile::kQuantised;
  STGS_TRY(write_scene(folder + "/packed.stgs", scene, settings));
  STGS_TRY(write_steady(folder));
  const std::optional<StartCamera> start = scene.metadata.start_camera;
  scene.metadata.start_camera.reset();
  STGS_TRY(write_scene(folder + "/no_camera.stgs", scene, settings));
  scene.metadata.frames = 2 * kFrames;
  scene.metadata.start_camera = start;
  return write_scene(folder + "/longer.stgs", scene, settings);
}

}  // namespace
}  // namespace stgs

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fputs("usage: make_fixture FOLDER\n", stderr);
    return 1;
  }
  const stgs::Status status = stgs::write_all(argv[1]);
  if (!status.ok()) std::fprintf(stderr, "make_fixture: %s\n", status.message().c_str());
  return static_cast<int>(status.code());
}
