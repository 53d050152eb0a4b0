#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Compares STGS's perceptual loss and its gradient with PyTorch's, on a VGG16 of random weights.

usage: compare_vgg16.py PERCEPTUAL_PROBE [cpu] [cuda] [cuda-float]

PyTorch computes in double, from torchvision's own VGG16. Exit code 0: every relative error is within
its bound; 1: one is not; 77: PyTorch, torchvision or safetensors is missing.
"""
import copy
import os
import statistics
import subprocess
import sys
import tempfile

try:
    import torch
    import torchvision
    from safetensors.torch import save_file
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)

# Bounds of the relative errors: of the loss; of the gradient (norm of the difference), median over
# the image pairs; of the gradient, largest. The gradient is discontinuous where a feature crosses
# zero or two inputs of a pooling are equal, so rounding can flip the gradient of a few features.
# TF32 (cuda) keeps 10 bits of each factor and flips several.
BOUNDS = {"cpu": (1e-5, 1e-3, 1e-2), "cuda-float": (1e-5, 1e-3, 1e-2), "cuda": (1e-3, 8e-2, 0.15)}
TAPS = {3: 64, 8: 128, 15: 256, 22: 512, 29: 512}  # torchvision's index of each ReLU: channels
MEAN = torch.tensor([0.485, 0.456, 0.406], dtype=torch.double).view(3, 1, 1)
DEVIATION = torch.tensor([0.229, 0.224, 0.225], dtype=torch.double).view(3, 1, 1)


def make_weights(linear):
    torch.manual_seed(1)
    network = torchvision.models.vgg16(weights=None).features
    for layer in network:
        if isinstance(layer, torch.nn.Conv2d):
            torch.nn.init.kaiming_uniform_(layer.weight, nonlinearity="relu")
            torch.nn.init.uniform_(layer.bias, -0.05, 0.05)
    channel_weights = [torch.rand(n) if linear else torch.full((n,), 1 / n) for n in TAPS.values()]
    tensors = {f"features.{name}": values for name, values in network.state_dict().items()}
    if linear:
        for tap, values in enumerate(channel_weights):
            tensors[f"lin{tap}.model.1.weight"] = values.view(1, -1, 1, 1).contiguous()
    return network.double(), channel_weights, tensors


def lpips(network, channel_weights, rendered, ground_truth):
    """LPIPS as published: features of the taps, scaled to unit length at each pixel."""
    loss = 0
    a, b = ((image - MEAN.to(image)) / DEVIATION.to(image) for image in (rendered, ground_truth))
    a, b = a[None], b[None]
    taps = iter(channel_weights)
    for number, layer in enumerate(network[:30]):
        a, b = layer(a), layer(b)
        if number in TAPS:
            unit_a, unit_b = (x / torch.sqrt((x ** 2).sum(1, keepdim=True) + 1e-10)
                              for x in (a, b))
            weights = next(taps).to(a).view(1, -1, 1, 1)
            loss = loss + (weights * (unit_a - unit_b) ** 2).sum(1).mean()
    return loss


def pytorch_loss(network, channel_weights, rendered, ground_truth, dtype):
    """Returns PyTorch's loss and its gradient with respect to the rendered image."""
    device = next(network.parameters()).device
    x = rendered.to(device, dtype).requires_grad_()
    y = ground_truth.permute(2, 0, 1).to(device, dtype) / 255
    loss = lpips(network, channel_weights, x, y)
    loss.backward()
    return loss.item(), x.grad.double().cpu()


def stgs_loss(probe, backend, weights, rendered, ground_truth, folder):
    """Returns the loss and the gradient that STGS computes."""
    files = [os.path.join(folder, name) for name in ("rendered", "ground_truth", "gradient")]
    rendered.numpy().tofile(files[0])
    ground_truth.numpy().tofile(files[1])
    height, width = ground_truth.shape[:2]
    printed = subprocess.run([probe, weights, str(width), str(height), *files, backend],
                             stdout=subprocess.PIPE, check=True).stdout
    with open(files[2], "rb") as file:
        gradient = torch.frombuffer(bytearray(file.read()), dtype=torch.float32)
    return float(printed), gradient.view(3, height, width).double()


def main():
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    probe, backends = sys.argv[1], sys.argv[2:] or ["cpu"]
    device = "cuda" if torch.cuda.is_available() else "cpu"
    errors = {name: ([], []) for name in backends}
    torch.backends.cudnn.allow_tf32 = True
    if device == "cuda":
        errors["pytorch-tf32"] = ([], [])  # for comparison
    with tempfile.TemporaryDirectory() as folder:
        for linear in (False, True):
            network, channel_weights, tensors = make_weights(linear)
            network = network.to(device)
            for layer in network:
                if isinstance(layer, torch.nn.ReLU):
                    layer.inplace = False
            weights = os.path.join(folder, "vgg16.safetensors")
            save_file(tensors, weights)
            for width, height, noise in ((96, 64, 0.3), (131, 77, 0.1), (256, 256, 0.03)) * 2:
                ground_truth = (torch.rand(height, width, 3) * 255).to(torch.uint8)
                exact = (ground_truth.permute(2, 0, 1).float() / 255).contiguous()
                rendered = exact + noise * torch.randn(3, height, width)
                loss, gradient = pytorch_loss(network, channel_weights, rendered, ground_truth,
                                              torch.double)
                for name, (loss_errors, gradient_errors) in errors.items():
                    if name == "pytorch-tf32":
                        found = pytorch_loss(copy.deepcopy(network).float(), channel_weights,
                                             rendered, ground_truth, torch.float)
                    else:
                        found = stgs_loss(probe, name, weights, rendered, ground_truth, folder)
                    loss_errors.append(abs(found[0] / loss - 1))
                    gradient_errors.append(((found[1] - gradient).norm() / gradient.norm()).item())
                print(f"{width}x{height}, noise {noise:.2f}, {'linear' if linear else 'uniform'}, "
                      f"loss {loss:.6f}: " + ", ".join(f"{name} {e[0][-1]:.1e} {e[1][-1]:.1e}"
                                                       for name, e in errors.items()), flush=True)
    failed = False
    for name, (loss_errors, gradient_errors) in errors.items():
        found = (max(loss_errors), statistics.median(gradient_errors), max(gradient_errors))
        within = name not in BOUNDS or all(e <= bound for e, bound in zip(found, BOUNDS[name]))
        failed |= not within
        print("{}: relative error of the loss {:.1e}, largest; of the gradient {:.1e}, median, and "
              "{:.1e}, largest{}".format(name, *found, "" if within else ": TOO LARGE"))
    sys.exit(failed)


if __name__ == "__main__":
    main()
