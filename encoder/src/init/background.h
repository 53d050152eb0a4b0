// SPDX-License-Identifier: Apache-2.0
// The static background of a camera, and the motion masks that follow from it.
#pragma once

#include <map>
#include <memory>
#include <mutex>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "init/view.h"
#include "stgs/encoder/prepared_capture.h"
#include "stgs/format/status.h"

namespace stgs::encoder::init {

struct Background {
  cv::Mat colour, valid;  // 8-bit RGB; 8-bit 0 or 255
  double noise = 1;       // standard deviation of a static pixel, grey levels
};

// Returns the frames, spread over the capture, that the background of a camera follows from. Those
// that the capture lacks are left out.
std::vector<int> background_frames(const PreparedCapture& capture, const View& view);
// Returns the background of a camera without frames.
Background unknown_background(const View& view);
// Returns the temporal median of a camera in its background frames. With `use_masks`, masked
// pixels do not count.
Result<Background> find_background(const PreparedCapture& capture, const View& view,
                                   bool use_masks);

// Returns the largest difference of a channel after a light blur, 8-bit.
cv::Mat difference(const cv::Mat& a, const cv::Mat& b);
// Returns the per-pixel threshold of a change from the background, CV_32F. It allows for noise, and
// for misregistration at edges.
cv::Mat change_threshold(const cv::Mat& background, double noise);
// How images are compared with a background.
struct ChangeTest {
  cv::Mat background;  // after a light blur
  // Levels above which a change is one, is certainly one, and suffices where pixels flow: 8-bit.
  cv::Mat weak, strong, flowing;
};
// `background`: RGB. `threshold`: that of change_threshold().
ChangeTest change_test(const cv::Mat& background, const cv::Mat& threshold);
// Returns the motion mask (0 or 255) of an image: where it has changed, without specks and small
// holes. `flowing`: 255 where pixels flow; empty: nowhere.
cv::Mat motion_mask(const cv::Mat& image, const ChangeTest& test, const cv::Mat& flowing = {});
// Returns the fraction of the pixels that are masked.
float share_of(const cv::Mat& mask);

// Adds a still mask at the size of the view to the memory of the capture
// (FrameMemory::add_still()).
void add_still(const PreparedCapture& capture, const View& view, const cv::Mat& mask);
// Adds the mask of a frame, at the size of the view, to the capture: to its memory, to its files,
// or to both.
Status add_mask(const PreparedCapture& capture, const View& view, int frame, const cv::Mat& mask);

// The background of a camera whose frames arrive window by window. It absorbs content that stays
// static, and follows slow changes of the light.
class LiveBackground {
 public:
  // `settle_frames`: frames after which static content becomes background, and a place with nothing
  // but background is still.
  LiveBackground(Background first, int settle_frames);

  // Continues with images of another size. Finer detail is learnt like changes of the light.
  void resize(cv::Size size);
  // Returns the motion mask of an image of the view's size.
  cv::Mat mask(const cv::Mat& image) const;
  // Learns from images of a window of `frames` frames, spread over it, and from the union of its
  // masks; no effect for fewer than 2 images.
  void learn(const std::vector<cv::Mat>& images, const cv::Mat& masked, int frames);
  // Returns the still mask: 255 where only background was visible for settle_frames.
  cv::Mat still() const;
  const Background& background() const { return background_; }

 private:
  void update();  // sets the members that follow from background_

  Background background_;
  int settle_frames_;
  cv::Mat threshold_;            // of background_
  ChangeTest test_;              // of background_
  cv::Mat candidate_, settled_;  // colour at rest that differs; for how many frames, CV_32S
  cv::Mat still_;                // frames for which a pixel was background, CV_32S
};

// The backgrounds of all cameras of a live capture. Thread-safe; an object that it returns is not.
class LiveBackgrounds {
 public:
  // `settle_frames`: see LiveBackground.
  explicit LiveBackgrounds(int settle_frames) : settle_frames_(settle_frames) {}
  // Returns null before add().
  LiveBackground* find(const std::string& camera);
  LiveBackground& add(const std::string& camera, Background first);

 private:
  const int settle_frames_;
  std::mutex mutex_;
  std::map<std::string, std::unique_ptr<LiveBackground>> cameras_;
};

}  // namespace stgs::encoder::init
