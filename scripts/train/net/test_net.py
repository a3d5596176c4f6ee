"""Tests of the keypoint net; they need PyTorch."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np
import onnxruntime
import pytest

torch = pytest.importorskip("torch", reason="PyTorch is missing (apt-get install python3-torch)")
from torch import distributed, multiprocessing

from roadplane_train.cars.mesh import MIRROR, REPOSITORY
from roadplane_train.net.calibrate import fit_sd
from roadplane_train.net.data import CONTEXT, INPUT_PX, RealCar, Sampler, Shards, apply, crop_from_box, read_real, warp
from roadplane_train.net.decode import Calibration, decode
from roadplane_train.net.evaluate import FRONT_BACK, Crop, confusion_of
from roadplane_train.net.export import export_onnx
from roadplane_train.net.loss import loss_of, peak_distance, targets
from roadplane_train.net.model import Deployed, StackedHourglass, gflop
from roadplane_train.net.start import read_weights, start
from roadplane_train.net.train import Training, average_gradients, parse_options

LABELS = REPOSITORY.parent / "shared/data/keypoints/train"


def labelled_car(rng: np.random.Generator) -> RealCar:
    """Returns a picture of noise with a bright dot at each keypoint of its left side."""
    patch = np.full((220, 220, 3), 40, np.uint8)
    points, flag = np.full((36, 2), np.nan), np.zeros(36, int)
    for k in range(18):
        points[k], flag[k] = rng.uniform(65, 155, 2).round(), 2
        x, y = points[k].astype(int)
        patch[y - 1 : y + 2, x - 1 : x + 2] = 255
    return RealCar("made up", patch, np.array([60.0, 60, 160, 160]), points, flag, "sedan")


class Data(unittest.TestCase):
    def test_a_crop_shows_the_picture_where_the_contract_says(self) -> None:
        box = np.array([100.0, 60.0, 180.0, 120.0])  # centre (140, 90)
        matrix = crop_from_box(box)
        crop_px = np.array([[63.5, 63.5], [0.0, 127.0]])
        picture = (
            140 + ((crop_px[:, 0] + 0.5) / 128 - 0.5) * 80 * CONTEXT,
            90 + ((crop_px[:, 1] + 0.5) / 128 - 0.5) * 80 * CONTEXT,
        )
        np.testing.assert_allclose(apply(matrix, np.stack(picture, 1)), crop_px, atol=1e-9)

    def test_shrinking_keeps_things_in_place(self) -> None:
        picture = np.zeros((600, 600, 3), np.uint8)
        picture[297:304, 197:204] = 255  # centred on (200, 300)
        matrix = crop_from_box(np.array([100.0, 100.0, 500.0, 500.0]))
        ys, xs = np.nonzero(crop := warp(picture, matrix)[..., 0].astype(float))
        weights = crop[ys, xs]
        seen = [(xs * weights).sum() / weights.sum(), (ys * weights).sum() / weights.sum()]
        np.testing.assert_allclose(seen, apply(matrix, np.array([[200.0, 300.0]]))[0], atol=0.1)

    def test_augmented_labels_stay_on_their_dots(self) -> None:
        rng = np.random.default_rng(0)
        with tempfile.TemporaryDirectory() as empty:
            sampler = Sampler(Shards(Path(empty)), [labelled_car(rng)], 24, 1.0, seed=[1])
        batch = sampler[0]
        contrast, sides = [], set()
        for image, points, located in zip(batch.image.numpy(), batch.points.numpy(), batch.located.numpy()):
            known = np.flatnonzero(located)
            sides.add(bool(known[0] >= 18))
            grey = image.astype(float).mean(2)
            x, y = np.clip(np.round(points[known]).astype(int), 0, INPUT_PX - 1).T
            contrast.append(grey[y, x].mean() - np.median(grey))
        self.assertGreater(np.median(contrast), 40)
        self.assertEqual(sides, {False, True}, "flips must exchange the sides")

    def test_real_labels_lie_in_their_crops(self) -> None:
        if not LABELS.exists():
            self.skipTest("no hand-labelled real cars beside the project")
        for car in read_real(LABELS):
            known = apply(crop_from_box(car.box), car.points[car.flag == 2])
            self.assertTrue(((known > -8) & (known < INPUT_PX + 8)).all(), car.source)
            self.assertNotIn("virat_0401", car.source)


class Decoding(unittest.TestCase):
    def test_a_gaussian_is_found_between_cells(self) -> None:
        at = np.array([[[41.3, 62.9], [77.7, 30.2]]])
        logits = torch.log(targets(torch.tensor(at, dtype=torch.float32), 32) + 1e-12).reshape(1, 2, 32, 32)
        mean, covariance = decode(logits.numpy())
        np.testing.assert_allclose(mean, at, atol=0.08)
        np.testing.assert_allclose(np.diagonal(covariance, axis1=2, axis2=3), 2.4**2, rtol=0.15)

    def test_the_distance_to_learn_from_is_that_of_the_decoded_peak(self) -> None:
        rng = np.random.default_rng(6)
        logits = torch.tensor(rng.normal(0, 3, (2, 36, 32, 32)), dtype=torch.float32, requires_grad=True)
        points, _ = decode(logits.detach().numpy())
        points[0] += rng.uniform(-6, 6, (36, 2))
        points[1] += 40  # another peak than the true one: no gradient
        off = peak_distance(logits, torch.tensor(points, dtype=torch.float32))
        expected = np.linalg.norm(points[0] - decode(logits[0].detach().numpy())[0], axis=1)
        np.testing.assert_allclose(off[0].detach().numpy(), expected, atol=0.02)
        off.sum().backward()
        self.assertTrue((logits.grad[0].abs().amax((1, 2)) > 0).all())
        self.assertTrue((logits.grad[1] == 0).all())

    def test_calibration_finds_the_law_that_made_the_errors(self) -> None:
        rng = np.random.default_rng(2)
        variance = rng.uniform(4, 40, 20_000)
        error = rng.normal(0, np.hypot(0.15 * variance, 1.0))
        error[::50] = 60  # gross errors
        a, b = fit_sd([(variance, error)])
        self.assertAlmostEqual(a, 0.15, delta=0.01)
        self.assertAlmostEqual(b, 1.0, delta=0.3)

    def test_a_measurement_holds_no_prior(self) -> None:
        # Locations drawn from the prior, with noise; the posterior mean regresses, the measurement does not.
        rng = np.random.default_rng(3)
        calibration = Calibration(0.2, 0.0, (60.0, 70.0), (30.0, 20.0))
        prior, noise = np.diag([30.0**2, 20.0**2]), np.array([[60.0, 25.0], [25.0, 90.0]])
        truth = rng.multivariate_normal([60, 70], prior, 50_000)
        seen = truth + rng.multivariate_normal([0, 0], noise, len(truth))
        posterior = np.linalg.inv(np.linalg.inv(prior) + np.linalg.inv(noise))
        mean = [60, 70] + (seen - [60, 70]) @ (np.eye(2) - posterior @ np.linalg.inv(prior)).T
        values, axes = np.linalg.eigh(posterior)
        variance = axes @ np.diag(np.sqrt(values) / 0.2) @ axes.T
        location, covariance = calibration.measurement(mean, np.broadcast_to(variance, (len(mean), 2, 2)))
        np.testing.assert_allclose(location, seen, atol=1e-9)
        np.testing.assert_allclose(covariance[0], noise, atol=1e-9)


def tiny_training(folder: Path) -> list[str]:
    """Returns eight crops of noise, and options to train on them."""
    rng = np.random.default_rng(5)
    crops, points = folder / "crops/train", rng.uniform(10, 118, (8, 36, 2)).astype(np.float32)
    crops.mkdir(parents=True)
    shard = {"image": rng.integers(0, 255, (8, 128, 128, 3), np.uint8), "keypoints": points}
    shard |= {"visible": np.ones((8, 36), np.uint8), "body": np.array(["sedan"] * 8)}
    np.savez(crops / "shard_00000.npz", **shard, **{name: np.ones(8) for name in ("box_side_px", "car_px", "elevation_deg")})
    options = ["--crops", str(crops.parent), "--runs", str(folder), "--channels", "16", "--stacks", "1"]
    return [*options, "--batch", "4", "--input-px", "64"]


def worker_gradient(meeting: str, worker: int) -> torch.Tensor:
    """Returns the agreed mean of worker 0, whose gradient is 1, and worker 1, whose gradient is 2."""
    distributed.init_process_group("gloo", init_method=meeting, rank=worker, world_size=2)
    net = torch.nn.Linear(3, 2, bias=False)
    net.weight.grad = torch.full((2, 3), 1.0 + worker)
    average_gradients(net)
    distributed.destroy_process_group()
    return net.weight.grad


class Confusion(unittest.TestCase):
    def test_exchanged_names_are_distinguished(self) -> None:
        points = np.random.default_rng(3).uniform(10, 118, (36, 2))
        everything = np.ones(36, bool)
        crop = Crop(np.zeros((128, 128, 3), np.uint8), points, everything, ~everything, 100, 100, "sedan", "t")
        self.assertIsNone(confusion_of(points, crop))
        self.assertEqual(confusion_of(points[MIRROR], crop), "left/right")
        self.assertEqual(confusion_of(points[FRONT_BACK], crop), "front/back")
        self.assertEqual(confusion_of(points[MIRROR][FRONT_BACK], crop), "turned round")


class Net(unittest.TestCase):
    def test_operations_are_counted(self) -> None:
        # 8 filters of 3 × 3 × 3 at 64 × 64 positions, a multiply-add counts two.
        self.assertAlmostEqual(gflop(torch.nn.Conv2d(3, 8, 3, 2, 1)), 2 * 8 * 27 * 64 * 64 / 1e9)
        self.assertGreater(gflop(Deployed(StackedHourglass(2, 48))), gflop(Deployed(StackedHourglass(1, 48))))

    def test_it_can_learn_one_car_by_heart(self) -> None:
        torch.manual_seed(0)
        rng = np.random.default_rng(4)
        with tempfile.TemporaryDirectory() as empty:
            batch = Sampler(Shards(Path(empty)), [labelled_car(rng)], 2, 1.0, seed=[5])[0]
        net = StackedHourglass(1, 16)
        optimiser = torch.optim.AdamW(net.parameters(), lr=5e-3)
        losses = []
        for _ in range(60):
            loss, _ = loss_of(net, batch)
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            losses.append(float(loss))
        self.assertLess(losses[-1], 0.75 * losses[0])

    def test_a_wider_net_starts_with_what_the_narrow_one_knows(self) -> None:
        torch.manual_seed(2)
        narrow, wide, image = StackedHourglass(2, 16), StackedHourglass(2, 24), torch.rand(2, 3, 128, 128)
        for parameter in narrow.parameters():  # equal ones would be stored once
            parameter.data += 0.02 * torch.randn_like(parameter)
        with tempfile.TemporaryDirectory() as folder:
            export_onnx(Deployed(narrow).eval(), Path(folder) / "net.onnx")
            weights = read_weights(Path(folder) / "net.onnx")
        start(wide, weights)
        with torch.no_grad():
            (expected, seen), (found, seen_too) = narrow(image), wide(image)
        for a, b in zip([*expected, seen], [*found, seen_too]):
            np.testing.assert_allclose(a.numpy(), b.numpy(), atol=1e-4)

    def test_a_net_of_more_stacks_starts_with_what_the_smaller_knows(self) -> None:
        torch.manual_seed(4)
        small, large, image = StackedHourglass(1, 16), StackedHourglass(3, 16), torch.rand(2, 3, 128, 128)
        start(large, small.state_dict())
        with torch.no_grad():
            ((expected,), seen), (found, seen_too) = small(image), large(image)
        for heatmaps in found:
            torch.testing.assert_close(heatmaps, expected)
        torch.testing.assert_close(seen_too, seen)

    def test_a_net_without_the_fine_part_can_be_started_from(self) -> None:
        torch.manual_seed(3)
        before, after, image = StackedHourglass(1, 16), StackedHourglass(1, 16), torch.rand(2, 3, 128, 128)
        start(after, {name: w for name, w in before.state_dict().items() if ".fine." not in name})
        with torch.no_grad():
            torch.testing.assert_close(before(image), after(image))
        with self.assertRaisesRegex(ValueError, "other parts: back.0.bias"):
            start(after, StackedHourglass(2, 16).state_dict())

    def test_a_killed_training_goes_on_as_if_it_had_not_been(self) -> None:
        with tempfile.TemporaryDirectory() as folder:
            common = tiny_training(Path(folder))

            def train(run: str, steps: int) -> Training:
                training = Training(parse_options([*common, "--run", run, "--steps", "6"]))
                training.read_crops()
                while training.step < steps:
                    training.advance()
                training.save()
                return training

            whole = train("whole", 6)
            train("killed", 3)
            resumed = train("killed", 6)
        for name, value in whole.average.weights.items():
            np.testing.assert_array_equal(value.numpy(), resumed.average.weights[name].numpy(), name)

    def test_workers_share_a_batch_and_come_to_the_same_bits_again(self) -> None:
        with tempfile.TemporaryDirectory() as folder:
            common = [*tiny_training(Path(folder)), "--workers", "2", "--steps", "3"]
            states = []
            for run in ("once", "again"):
                command = [sys.executable, "-m", "roadplane_train.net.train", *common, "--run", run]
                subprocess.run(command, check=True, timeout=120)
                states.append(torch.load(Path(folder) / run / "last.pt"))
        self.assertEqual([s["step"] for s in states], [3, 3])
        for name, value in states[0]["net"].items():
            np.testing.assert_array_equal(value.numpy(), states[1]["net"][name].numpy(), name)

    def test_gradients_are_the_mean_of_the_workers(self) -> None:
        with tempfile.TemporaryDirectory() as folder:
            spawn, meeting = multiprocessing.get_context("spawn"), f"file://{folder}/meeting"
            other = spawn.Process(target=worker_gradient, args=(meeting, 1))
            other.start()
            mean = worker_gradient(meeting, 0)
            other.join()
        np.testing.assert_allclose(mean.numpy(), np.full((2, 3), 1.5))

    def test_onnx_gives_what_pytorch_gives_at_any_batch(self) -> None:
        torch.manual_seed(1)
        for work_px in (64, 128):
            net = Deployed(StackedHourglass(2, 16), work_px).eval()
            with tempfile.TemporaryDirectory() as folder:
                export_onnx(net, Path(folder) / "net.onnx")
                session = onnxruntime.InferenceSession(f"{folder}/net.onnx", providers=["CPUExecutionProvider"])
            for count in (1, 3):
                image = torch.rand(count, 3, INPUT_PX, INPUT_PX)
                with torch.no_grad():
                    expected = net(image)
                found = session.run(["heatmaps", "visibility"], {"image": image.numpy()})
                self.assertEqual(found[0].shape, (count, 36, 32, 32))
                for a, b in zip(expected, found):
                    np.testing.assert_allclose(a.numpy(), b, atol=1e-4)
