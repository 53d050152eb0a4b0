// SPDX-License-Identifier: Apache-2.0
#include "capture_seeds.h"

#include <fmt/format.h>

#include <cmath>

namespace stgs::fuzz {
namespace {

constexpr const char* kNames[] = {"a", "b", "c", "d"};
constexpr const char* kK = "[9,0,4,0,9,3,0,0,1]";

// World-to-camera of camera i: a row of cameras that look along +z.
std::string pose(int i) {
  return fmt::format("[1,0,0,{},0,1,0,0.25,0,0,1,2,0,0,0,1]", -0.5 * i);
}

std::string image(int camera, int frame) {
  return tiny_bmp(kSeedWidth, kSeedHeight, static_cast<std::uint8_t>(40 * camera + 100 * frame));
}

// Appends the images of cameras, as folder/NAME/NNN.bmp.
void add_images(PackedFiles& capture, const std::string& folder, int cameras) {
  for (int i = 0; i < cameras; ++i) {
    for (int frame = 0; frame < kSeedFrames; ++frame) {
      capture.files.push_back(
          {fmt::format("{}{}/{:03}.bmp", folder, kNames[i], frame), image(i, frame)});
    }
  }
}

PackedFiles n3dv() {
  PackedFiles out{std::string(1, '\1'), {}};
  std::string poses("\x93NUMPY\x01\0\x76\0", 10);
  std::string header = "{'descr': '<f8', 'fortran_order': False, 'shape': (2, 17), }";
  header.resize(117, ' ');
  poses += header + "\n";
  for (int i = 0; i < 2; ++i) {
    for (const double v : {0.0, 1.0, 0.0, 0.5 * i, 1.0 * kSeedHeight,  //
                           1.0, 0.0, 0.0, 0.25, 1.0 * kSeedWidth,      //
                           0.0, 0.0, -1.0, -2.0, 9.0, 0.5, 9.0}) {
      append_value(poses, v);
    }
  }
  out.files.push_back({"poses_bounds.npy", poses});
  for (int i = 0; i < 2; ++i) {
    out.files.push_back({fmt::format("cam{}/0.bmp", i), image(i, 0)});
    out.files.push_back({fmt::format("cam{}/1.bmp", i), image(i, 1)});
  }
  return out;
}

std::string panoptic_meta(const std::vector<int>& cameras) {
  std::string ids, names, ks, poses;
  for (int frame = 0; frame < kSeedFrames; ++frame) {
    std::string id, name, k, w2c;
    for (const int i : cameras) {
      const char* const comma = i == cameras.front() ? "" : ",";
      id += fmt::format("{}{}", comma, i);
      name += fmt::format("{}\"{}/{:03}.bmp\"", comma, kNames[i], frame);
      k += fmt::format("{}[[9,0,4],[0,9,3],[0,0,1]]", comma);
      w2c += comma + pose(i);
    }
    const char* const comma = frame == 0 ? "" : ",";
    ids += fmt::format("{}[{}]", comma, id);
    names += fmt::format("{}[{}]", comma, name);
    ks += fmt::format("{}[{}]", comma, k);
    poses += fmt::format("{}[{}]", comma, w2c);
  }
  return fmt::format(R"({{"w":{},"h":{},"cam_id":[{}],"fn":[{}],"k":[{}],"w2c":[{}]}})", kSeedWidth,
                     kSeedHeight, ids, names, ks, poses);
}

PackedFiles panoptic() {
  PackedFiles out{std::string(1, '\0'), {}};
  out.files.push_back({"train_meta.json", panoptic_meta({0, 1})});
  out.files.push_back({"test_meta.json", panoptic_meta({2})});
  add_images(out, "ims/", 3);
  out.files.push_back({"seg/a/000.png", "x"});
  out.files.push_back({"seg/a/001.png", "x"});
  return out;
}

PackedFiles easyvolcap() {
  PackedFiles out{std::string(1, '\0'), {}};
  std::string intri = "%YAML:1.0\n---\nnames:\n   - \"a\"\n   - \"b\"\n", extri = intri;
  for (int i = 0; i < 2; ++i) {
    intri += fmt::format(
        "K_{0}: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n"
        "   data: [ 9., 0., 4., 0., 9., 3., 0., 0., 1. ]\n"
        "D_{0}: [ 0.1, 0.01, 0., 0., 0. ]\nH_{0}: {1}\nW_{0}: {2}\n",
        kNames[i], kSeedHeight, kSeedWidth);
    extri += fmt::format("R_{0}: [ 0., 0.1, 0. ]\nT_{0}: [ {1}, 0.25, 2. ]\n", kNames[i], -0.5 * i);
  }
  out.files = {{"intri.yml", intri}, {"extri.yml", extri}};
  add_images(out, "images/", 2);
  out.files.push_back({"mask/a/000.png", "x"});
  out.files.push_back({"mask/a/001.png", "x"});
  return out;
}

PackedFiles nerfstudio() {
  PackedFiles out{std::string(1, '\0'), {}};
  std::string frames;
  for (int i = 0; i < 3; ++i) {
    for (int frame = 0; frame < kSeedFrames; ++frame) {
      frames +=
          fmt::format(R"({}{{"file_path":"images/{}/{:03}.bmp","time":{},"camera":"{}",)"
                      R"("transform_matrix":[[1,0,0,{}],[0,-1,0,0],[0,0,-1,2],[0,0,0,1]]}})",
                      frames.empty() ? "" : ",", kNames[i], frame, 0.5 * frame, kNames[i], 0.5 * i);
    }
  }
  out.files.push_back(
      {"transforms.json",
       fmt::format(
           R"({{"w":{},"h":{},"fl_x":9,"cx":4,"cy":3,"k1":0.01,"camera_model":"OPENCV","fps":30,)"
           R"("test_filenames":["images/b/000.bmp"],"frames":[{}]}})",
           kSeedWidth, kSeedHeight, frames)});
  add_images(out, "images/", 3);
  return out;
}

PackedFiles colmap(std::vector<PackedFile> model) {
  PackedFiles out{std::string(1, '\0'), std::move(model)};
  add_images(out, "images/", 2);
  return out;
}

PackedFiles videos_with_cameras() {
  PackedFiles out{std::string(1, '\6'), {}};
  std::string cameras;
  for (int i = 0; i < 2; ++i) {
    cameras += fmt::format(R"({}"{}":{{"K":{},"w2c":{},"dist":[{},0,0,0],"width":{},"height":{}}})",
                           i == 0 ? "" : ",", kNames[i], kK, pose(i), i == 0 ? 0.1 : 0.0,
                           kSeedWidth, kSeedHeight);
  }
  out.files.push_back({"cameras.json", fmt::format(R"({{"pixel_centre":0,"fps":25,"metric":true,)"
                                                   R"("cameras":{{{}}}}})",
                                                   cameras)});
  add_images(out, "", 2);
  out.files.push_back({"flow/b/000000.flo", "x"});
  out.files.push_back({"masks/b/000.png", "x"});
  out.files.push_back({"masks/b/001.png", "x"});
  return out;
}

PackedFiles plain(std::vector<PackedFile> calibration) {
  PackedFiles out{std::string(1, '\0'), std::move(calibration)};
  add_images(out, "", 2);
  return out;
}

// Videos, links, a pipe, and names that lead out of the folder.
PackedFiles hostile() {
  PackedFiles out{std::string(1, '\6'), {}};
  out.files = {{"videos/a.mp4", std::string("\0\0\0\x14"
                                            "ftypisom",
                                            12)},
               {"videos/b.mkv", "\x1a\x45\xdf\xa3 matroska"},
               {"videos/c.mp4@", "../../outside.mp4"},
               {"images@", "/etc"},
               {"b.mp4|", ""},
               {"masks@", "masks"},
               {"flow/", ""},
               {"cameras.json", fmt::format(R"([{{"name":"../a","K":{0},"w2c":{1}}},)"
                                            R"({{"name":"a","K":{0},"w2c":{1}}}])",
                                            kK, pose(0))}};
  return out;
}

}  // namespace

std::vector<PackedFile> colmap_text_model() {
  return {{"sparse/0/cameras.txt",
           "# cameras\n1 OPENCV 8 6 9 9 4 3 0.1 0 0 0\n2 RADIAL 8 6 9 4 3 0 0\n"},
          {"sparse/0/images.txt",
           "# images\n1 1 0 0 0 0.5 0.25 2 1 a/000.bmp\n1 2 3 4 5 -1\n2 1 0 0 0 0 0.25 2 2 "
           "b/000.bmp\n\n"},
          {"sparse/0/points3D.txt", "1 0.5 0.5 3 255 0 10 0.3 1 0 2 0\n2 1 -1 4 1 2 3 0.1 1 1\n"}};
}

std::vector<PackedFile> colmap_binary_model() {
  std::string cameras, images, points;
  append_value(cameras, std::uint64_t{2});
  append_value(images, std::uint64_t{2});
  append_value(points, std::uint64_t{1});
  for (std::uint32_t i = 0; i < 2; ++i) {
    append_value(cameras, i);
    append_value(cameras, i == 0 ? 1u : 4u);  // PINHOLE, OPENCV
    append_value(cameras, std::uint64_t{kSeedWidth});
    append_value(cameras, std::uint64_t{kSeedHeight});
    for (const double v : {9.0, 9.0, 4.0, 3.0}) append_value(cameras, v);
    for (int k = 0; i == 1 && k < 4; ++k) append_value(cameras, 0.01 * k);
    append_value(images, i + 7);
    for (const double v : {1.0, 0.0, 0.0, 0.0, -0.5 * i, 0.25, 2.0}) append_value(images, v);
    append_value(images, i);
    images += std::string(kNames[i]) + "/000.bmp" + '\0';
    append_value(images, std::uint64_t{i});  // features
    images.append(24 * i, 'f');
  }
  append_value(points, std::uint64_t{1});
  for (const double v : {0.5, 0.5, 3.0}) append_value(points, v);
  points += "\xff\x10\x20";
  append_value(points, 0.25);
  append_value(points, std::uint64_t{2});
  points.append(16, 't');
  return {{"sparse/0/cameras.bin", cameras},
          {"sparse/0/images.bin", images},
          {"sparse/0/points3D.bin", points}};
}

std::string toml_calibration() {
  std::string out;
  for (int i = 0; i < 2; ++i) {
    out += fmt::format(
        "[{}]\nname = \"{}\"\nsize = [ 8.0, 6.0]\nmatrix = [ [ 9.0, 0.0, 4.0], [ 0.0, 9.0, 3.0], "
        "[ 0.0, 0.0, 1.0]]\ndistortions = [ 0.1, 0.0, 0.0, 0.0]\nrotation = [ 0.0, {}, 0.0]\n"
        "translation = [ 0.5, 0.0, 2.0]\nfisheye = {}\n\n",
        kNames[i], kNames[i], 0.1 * i, i == 0 ? "false" : "true");
  }
  return out + "[metadata]\nadjusted = false\nerror = 0.1\n";
}

std::string qualisys_calibration() {
  std::string cameras;
  for (int i = 0; i < 2; ++i) {
    cameras += fmt::format(
        "<camera active=\"1\" serial=\"{}\" viewrotation=\"0\"><fov_video left=\"0\" top=\"0\" "
        "right=\"7\" bottom=\"5\"/><transform x=\"{}\" y=\"0\" z=\"2000\" r11=\"1\" r12=\"0\" "
        "r13=\"0\" r21=\"0\" r22=\"1\" r23=\"0\" r31=\"0\" r32=\"0\" r33=\"1\"/><intrinsic "
        "focalLengthU=\"576\" focalLengthV=\"576\" centerPointU=\"256\" centerPointV=\"192\" "
        "skew=\"0\" radialDistortion1=\"0.1\" radialDistortion2=\"0\" radialDistortion3=\"0\" "
        "tangentalDistortion1=\"0\" tangentalDistortion2=\"0\"/></camera>\n",
        kNames[i], 500 * i);
  }
  return "<?xml version=\"1.0\"?>\n<calibration created=\"x\"><cameras>" + cameras +
         "</cameras></calibration>\n";
}

std::string yaml_calibration(int camera) {
  return fmt::format(
      "%YAML:1.0\n---\nimage_width: 8\nimage_height: 6\ncamera_matrix: !!opencv-matrix\n   rows: "
      "3\n   cols: 3\n   dt: d\n   data: [ 9., 0., 4., 0., 9., 3., 0., 0., 1. ]\n"
      "dist_coeffs: [ 0.1, 0., 0., 0. ]\nR: [ 0., 0.1, 0. ]\nT: [ {}, 0., 2. ]\n",
      0.25 + camera);
}

std::string json_calibration(int camera) {
  return fmt::format(
      R"({{"K":[[9.0,0.0,4.0],[0.0,9.0,3.0],[0.0,0.0,1.0]],"D":[0.1,0.0,0.0,0.0],)"
      R"("rvec":[0.0,0.1,0.0],"tvec":[{},0.0,2.0],"width":8,"height":6,"fisheye":1}})",
      0.5 + camera);
}

std::string xml_calibration(int camera) {
  return fmt::format(
      "<?xml version=\"1.0\"?>\n<opencv_storage>\n<K type_id=\"opencv-matrix\"><rows>3</rows>"
      "<cols>3</cols><dt>d</dt><data>9. 0. 4. 0. 9. 3. 0. 0. 1.</data></K>\n"
      "<dist>0.1 0. 0. 0.</dist>\n<R>0. 0.1 0.</R>\n<T>{} 0. 2.</T>\n</opencv_storage>\n",
      0.5 + camera);
}

std::vector<PackedFiles> capture_seeds() {
  std::vector<PackedFiles> out = {n3dv(),
                                  panoptic(),
                                  easyvolcap(),
                                  nerfstudio(),
                                  colmap(colmap_text_model()),
                                  colmap(colmap_binary_model()),
                                  videos_with_cameras(),
                                  hostile()};
  out.push_back(plain({{"calib.toml", toml_calibration()}}));
  out.push_back(plain({{"session.qca.txt", qualisys_calibration()}}));
  out.push_back(plain({{"a.yml", yaml_calibration(0)}, {"b.json", json_calibration(1)}}));
  out.push_back(
      plain({{"calibration/a.xml", xml_calibration(0)}, {"b.yaml", yaml_calibration(1)}}));
  out.push_back(plain({}));
  return out;
}

}  // namespace stgs::fuzz
