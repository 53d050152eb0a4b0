// SPDX-License-Identifier: Apache-2.0
#include "stgs/encoder/device_image.h"

namespace stgs::encoder {

KeptDevice::KeptDevice() = default;
KeptDevice::~KeptDevice() = default;

Status copy_from_device(const DeviceRows&, std::uint8_t*) {
  return not_built("this build has no CUDA support; copy the image to the host");
}

}  // namespace stgs::encoder
