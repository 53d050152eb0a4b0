// SPDX-License-Identifier: Apache-2.0
#include "frame_converter.h"

#include <algorithm>
#include <cerrno>
#include <utility>

#include "geometry/warp_tables.h"
#include "gpu_frame.h"

extern "C" {
#include <libavutil/error.h>
#include <libavutil/opt.h>
#include <libavutil/pixdesc.h>
}

namespace stgs::encoder {
namespace {

Status no_memory() {
  return ffmpeg_error(AVERROR(ENOMEM));
}

// Returns the format with the same memory that does not imply a range, and sets `full` if `format`
// implies the full range.
AVPixelFormat without_range(AVPixelFormat format, bool& full) {
  constexpr std::pair<AVPixelFormat, AVPixelFormat> kFull[] = {
      {AV_PIX_FMT_YUVJ411P, AV_PIX_FMT_YUV411P},
      {AV_PIX_FMT_YUVJ420P, AV_PIX_FMT_YUV420P},
      {AV_PIX_FMT_YUVJ422P, AV_PIX_FMT_YUV422P},
      {AV_PIX_FMT_YUVJ440P, AV_PIX_FMT_YUV440P},
      {AV_PIX_FMT_YUVJ444P, AV_PIX_FMT_YUV444P}};
  for (const auto& [implying, other] : kFull) {
    if (format != implying) continue;
    full = true;
    return other;
  }
  return format;
}

bool is_grey(AVPixelFormat format) {
  const AVPixFmtDescriptor* const layout = av_pix_fmt_desc_get(format);
  return layout != nullptr && layout->nb_components <= 2 &&
         (layout->flags & (AV_PIX_FMT_FLAG_RGB | AV_PIX_FMT_FLAG_PAL)) == 0;
}

// Position of a chroma sample from its first pixel along an axis, 1/256 pixels, if one covers
// 2^shift pixels: at the first (0), between all (1) or at the last (2).
int chroma_position(int shift, int place) {
  return place * ((1 << shift) - 1) * 128;
}

// The positions for a chroma location, if a sample covers 2^shift pixels along the axis.
int horizontal_position(AVChromaLocation c, int shift) {
  const bool is_left =
      c == AVCHROMA_LOC_LEFT || c == AVCHROMA_LOC_TOPLEFT || c == AVCHROMA_LOC_BOTTOMLEFT;
  return chroma_position(shift, is_left ? 0 : 1);
}
int vertical_position(AVChromaLocation c, int shift) {
  const bool is_top = c == AVCHROMA_LOC_TOP || c == AVCHROMA_LOC_TOPLEFT;
  const bool is_bottom = c == AVCHROMA_LOC_BOTTOM || c == AVCHROMA_LOC_BOTTOMLEFT;
  return chroma_position(shift, is_top ? 0 : is_bottom ? 2 : 1);
}

bool is_known(AVColorSpace matrix) {
  constexpr AVColorSpace kKnown[] = {
      AVCOL_SPC_RGB,       AVCOL_SPC_BT709,     AVCOL_SPC_FCC,        AVCOL_SPC_BT470BG,
      AVCOL_SPC_SMPTE170M, AVCOL_SPC_SMPTE240M, AVCOL_SPC_BT2020_NCL, AVCOL_SPC_UNSPECIFIED};
  return std::find(std::begin(kKnown), std::end(kKnown), matrix) != std::end(kKnown);
}

// Returns the coefficients that swscale derives from those of a matrix.
geometry::YuvCoefficients coefficients_of(const int* matrix, bool full_range) {
  const auto rounded = [](std::int64_t value) {  // to 13 bits after the point
    return static_cast<int>(std::clamp<std::int64_t>((value + (1 << 15)) >> 16, -0x7fff, 0x7fff));
  };
  const auto chroma = [&](std::int64_t value) {
    return rounded((full_range ? value * 224 / 255 : value) * (1 << 13));
  };
  const std::int64_t one = 1 << 16;
  return {full_range ? 0 : rounded((16 * one) << 9),
          rounded((full_range ? one : one * 255 / 219) << 13),
          chroma(matrix[0]),
          chroma(-matrix[3]),
          chroma(-matrix[2]),
          chroma(matrix[1])};
}

// Expands 8-bit grey of limited range, which swscale copies.
void expand_range(cv::Mat& image) {
  image.convertTo(image, -1, 255.0 / 219, -16 * 255.0 / 219);
}

}  // namespace

Status ffmpeg_error(int error) {
  if (error == AVERROR(ENOMEM)) return {StatusCode::kNoMemory, "not enough memory"};
  char text[AV_ERROR_MAX_STRING_SIZE];
  std::string reason = av_make_error_string(text, sizeof text, error);
  for (const int of_system : {EAGAIN, EIO, EMFILE, ENFILE}) {
    if (error == AVERROR(of_system)) return {StatusCode::kIo, std::move(reason)};
  }
  const bool lacks = error == AVERROR_PATCHWELCOME || error == AVERROR_DECODER_NOT_FOUND;
  return {lacks ? StatusCode::kUnsupported : StatusCode::kInvalidFile, std::move(reason)};
}

FrameConverter::Form FrameConverter::form_of(const AVFrame& frame, AVPixelFormat stated) {
  Form form;
  form.width = frame.width;
  form.height = frame.height;
  const bool is_stated = frame.color_range != AVCOL_RANGE_UNSPECIFIED;
  bool full = is_stated ? frame.color_range == AVCOL_RANGE_JPEG : is_grey(stated);
  form.chroma = frame.chroma_location;
  bool is_jpeg = false;
  form.pixels = without_range(stated, is_jpeg);
  if (frame.format != stated) form.pixels = static_cast<AVPixelFormat>(frame.format);
  form.full_range = full || is_jpeg;
  if (form.chroma == AVCHROMA_LOC_UNSPECIFIED)
    form.chroma = is_jpeg ? AVCHROMA_LOC_CENTER : AVCHROMA_LOC_LEFT;
  form.matrix = frame.colorspace;
  if (form.matrix == AVCOL_SPC_UNSPECIFIED || form.matrix == AVCOL_SPC_RGB)
    form.matrix = frame.width >= 1280 || frame.height > 576 ? AVCOL_SPC_BT709 : AVCOL_SPC_SMPTE170M;
  return form;
}

Result<FrameConverter::Scaler> FrameConverter::make_scaler(const Form& form) {
  Scaler scaler(sws_alloc_context());
  if (scaler == nullptr) return no_memory();
  const auto set = [&](const char* option, std::int64_t value) {
    av_opt_set_int(scaler.get(), option, value, 0);
  };
  set("srcw", form.width);
  set("srch", form.height);
  set("src_format", form.pixels);
  set("dstw", form.width);
  set("dsth", form.height);
  set("dst_format", AV_PIX_FMT_BGR24);
  // Without the last three, swscale repeats each chroma value for all of its pixels.
  set("sws_flags", SWS_BICUBIC | SWS_ACCURATE_RND | SWS_FULL_CHR_H_INP | SWS_FULL_CHR_H_INT);
  const AVPixFmtDescriptor* const layout = av_pix_fmt_desc_get(form.pixels);
  if (layout != nullptr && layout->log2_chroma_w > 0)
    set("src_h_chr_pos", horizontal_position(form.chroma, layout->log2_chroma_w));
  if (layout != nullptr && layout->log2_chroma_h > 0)
    set("src_v_chr_pos", vertical_position(form.chroma, layout->log2_chroma_h));
  // It fails for RGB, which has no matrix.
  sws_setColorspaceDetails(scaler.get(), sws_getCoefficients(form.matrix), form.full_range,
                           sws_getCoefficients(SWS_CS_DEFAULT), 1, 0, 1 << 16, 1 << 16);
  const int error = sws_init_context(scaler.get(), nullptr, nullptr);
  if (error < 0) return ffmpeg_error(error);
  return scaler;
}

std::shared_ptr<const geometry::YuvRule> FrameConverter::gpu_rule(const AVFrame& frame,
                                                                  AVPixelFormat stated) {
  const Form form = form_of(frame, stated);
  const bool has_size = form.width % 2 == 0 && form.height % 2 == 0 &&
                        std::min(form.width, form.height) >= geometry::kMinYuvSide;
  if (!is_gpu_format(stated) || !has_size || !is_known(frame.colorspace)) return nullptr;
  if (rule_ && form == rule_form_) return rule_;
  const auto site = [](int position) {
    return position == 0     ? geometry::ChromaSite::kFirst
           : position == 128 ? geometry::ChromaSite::kBetween
                             : geometry::ChromaSite::kSecond;
  };
  auto rule = std::make_shared<geometry::YuvRule>();
  rule->coefficients = coefficients_of(sws_getCoefficients(form.matrix), form.full_range);
  rule->columns = geometry::chroma_taps(form.width, site(horizontal_position(form.chroma, 1)),
                                        geometry::kColumnWeightBits);
  rule->rows = geometry::chroma_taps(form.height, site(vertical_position(form.chroma, 1)),
                                     geometry::kRowWeightBits);
  rule_ = std::move(rule);
  rule_form_ = form;
  return rule_;
}

Result<cv::Mat> FrameConverter::convert(const AVFrame& frame, AVPixelFormat stated) {
  if (!is_known(frame.colorspace)) {
    const char* const name = av_color_space_name(frame.colorspace);
    return unsupported("its colours have the matrix '{}'; convert the video to BT.709 first",
                       name == nullptr ? "unknown" : name);
  }
  const Form form = form_of(frame, stated);
  if (scaler_ == nullptr || !(form == form_)) {
    STGS_ASSIGN(scaler_, make_scaler(form));
    form_ = form;
  }
  cv::Mat image(form.height, form.width, CV_8UC3);
  std::uint8_t* planes[4] = {image.data};
  const int strides[4] = {static_cast<int>(image.step)};
  const int error =
      sws_scale(scaler_.get(), frame.data, frame.linesize, 0, form.height, planes, strides);
  if (error < 0) return ffmpeg_error(error);
  if (form.pixels == AV_PIX_FMT_GRAY8 && !form.full_range) expand_range(image);
  return image;
}

}  // namespace stgs::encoder
