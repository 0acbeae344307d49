"""PoseEstimate: `detections`, vision_msgs/Detection3DArray as of vision_msgs 4."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from pmcl_ros.messages.header import header_to_message
from pmcl_ros.messages.pose import pose_to_message
from pmcl_ros.messages.types import PoseWithCovariance, Vector3
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.object_model import ObjectModel


def estimates_to_detections(classes: Callable[[str], Any], names: Sequence[str],
                            models: Sequence[ObjectModel],
                            estimates: Sequence[PoseEstimate]) -> Any:
    """The objects of one capture that were found; none where all are lost.

    id: the name; class_id: that of the model, which copies share. score: share of the posterior,
    0 to 1; 1 of an estimate without modes. The box is that of the mesh, in its axes [m].
    """
    header = header_to_message(estimates[0].header)

    def detection(name: str, model: ObjectModel, estimate: PoseEstimate) -> Any:
        low, high = model.vertices.min(axis=0), model.vertices.max(axis=0)
        centre = estimate.pose.copy()
        centre[:3, 3] += estimate.pose[:3, :3] @ (low + high) / 2
        score = estimate.modes[0].weight if estimate.modes else 1.0
        return classes('vision_msgs/msg/Detection3D')(
            header=header, id=name,
            results=[classes('vision_msgs/msg/ObjectHypothesisWithPose')(
                hypothesis=classes('vision_msgs/msg/ObjectHypothesis')(
                    class_id=model.name, score=float(score)),
                pose=PoseWithCovariance(
                    pose=pose_to_message(estimate.pose),
                    covariance=estimate.covariance.astype(float).ravel()))],
            bbox=classes('vision_msgs/msg/BoundingBox3D')(
                center=pose_to_message(centre),
                size=Vector3(**dict(zip('xyz', np.subtract(high, low).tolist(), strict=True)))))

    return classes('vision_msgs/msg/Detection3DArray')(header=header, detections=[
        detection(*each) for each in zip(names, models, estimates, strict=True)
        if not each[2].lost])
