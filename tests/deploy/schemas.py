"""What Kubernetes and KubeRay accept, as JSON schemas: what a farm needs of their API, closed to anything else.

Fields, types and allowed values follow KubeRay's API reference (ray.io/v1, KubeRay 1.6) and that of Kubernetes 1.34.
A field that is misspelt, misplaced or of the wrong type is refused, as the API server would refuse it.
"""

from __future__ import annotations

from typing import Any

Schema = dict[str, Any]

TEXT: Schema = {"type": "string", "minLength": 1}
TEXTS: Schema = {"type": "array", "items": TEXT}
COUNT: Schema = {"type": "integer", "minimum": 0, "maximum": 2**31 - 1}
FLAG: Schema = {"type": "boolean"}
PORT: Schema = {"type": "integer", "minimum": 1, "maximum": 65535}
NAME: Schema = {"type": "string", "pattern": r"^[a-z0-9]([-a-z0-9]{0,61}[a-z0-9])?$"}
QUANTITY: Schema = {"type": "string", "pattern": r"^[0-9]+(\.[0-9]+)?(m|k|M|G|T|Ki|Mi|Gi|Ti)?$"}
LABELS: Schema = {
    "type": "object",
    "propertyNames": {"pattern": r"^([a-z0-9.-]+/)?[A-Za-z0-9]([A-Za-z0-9._-]{0,61}[A-Za-z0-9])?$"},
    "additionalProperties": {"type": "string", "maxLength": 63},
}
# Values of `ray start` are texts, numbers too.
START_PARAMETERS: Schema = {"type": "object", "additionalProperties": {"type": "string"}}


def closed(required: tuple[str, ...] = (), **properties: Schema) -> Schema:
    """An object with these properties alone."""
    return {"type": "object", "properties": properties, "required": list(required), "additionalProperties": False}


def many(items: Schema, least: int = 1) -> Schema:
    """A list."""
    return {"type": "array", "items": items, "minItems": least}


def one_of(*values: str) -> Schema:
    """One of some words."""
    return {"enum": list(values)}


METADATA = closed(("name",), name=NAME, namespace=NAME, labels=LABELS, annotations={"type": "object"})
SELECTOR = closed(matchLabels=LABELS)
AMOUNTS: Schema = {"type": "object", "additionalProperties": QUANTITY}
RESOURCES = closed(requests=AMOUNTS, limits=AMOUNTS)
CONTAINER = closed(
    ("name", "image"),
    name=NAME,
    image=TEXT,
    imagePullPolicy=one_of("Always", "IfNotPresent", "Never"),
    command=TEXTS,
    args=TEXTS,
    env=many(closed(("name",), name=TEXT, value={"type": "string"}, valueFrom={"type": "object"})),
    ports=many(closed(("containerPort",), containerPort=PORT, name=NAME, protocol=one_of("TCP", "UDP", "SCTP"))),
    resources=RESOURCES,
    securityContext=closed(
        allowPrivilegeEscalation=FLAG,
        capabilities=closed(add=TEXTS, drop=TEXTS),
        readOnlyRootFilesystem=FLAG,
        runAsNonRoot=FLAG,
        runAsUser=COUNT,
    ),
    volumeMounts=many(closed(("name", "mountPath"), name=NAME, mountPath=TEXT, subPath=TEXT, readOnly=FLAG)),
)
POD_TEMPLATE = closed(
    ("spec",),
    metadata=closed(labels=LABELS, annotations={"type": "object"}),
    spec=closed(
        ("containers",),
        automountServiceAccountToken=FLAG,
        containers=many(CONTAINER),
        nodeSelector=LABELS,
        restartPolicy=one_of("Always", "OnFailure", "Never"),
        securityContext=closed(fsGroup=COUNT, runAsGroup=COUNT, runAsNonRoot=FLAG, runAsUser=COUNT),
        serviceAccountName=NAME,
        terminationGracePeriodSeconds=COUNT,
        tolerations=many({"type": "object"}),
        volumes=many(
            closed(
                ("name",),
                name=NAME,
                emptyDir=closed(medium=one_of("", "Memory"), sizeLimit=QUANTITY),
                persistentVolumeClaim=closed(("claimName",), claimName=NAME, readOnly=FLAG),
            )
        ),
    ),
)
RAY_CLUSTER_SPEC = closed(
    ("headGroupSpec",),
    authOptions=closed(mode=one_of("disabled", "token"), secretName=NAME, enableK8sTokenAuth=FLAG),
    autoscalerOptions=closed(
        idleTimeoutSeconds=COUNT, upscalingMode=one_of("Default", "Aggressive", "Conservative"), resources=RESOURCES
    ),
    enableInTreeAutoscaling=FLAG,
    headGroupSpec=closed(
        ("template", "rayStartParams"),
        enableIngress=FLAG,
        rayStartParams=START_PARAMETERS,
        serviceType=one_of("ClusterIP", "NodePort", "LoadBalancer"),
        template=POD_TEMPLATE,
    ),
    managedBy=TEXT,
    rayVersion={"type": "string", "pattern": r"^\d+\.\d+\.\d+$"},
    suspend=FLAG,
    workerGroupSpecs=many(
        closed(
            ("groupName", "template", "rayStartParams"),
            groupName=NAME,
            idleTimeoutSeconds=COUNT,
            maxReplicas=COUNT,
            minReplicas=COUNT,
            numOfHosts=COUNT,
            rayStartParams=START_PARAMETERS,
            replicas=COUNT,
            suspend=FLAG,
            template=POD_TEMPLATE,
        )
    ),
)
RAY_JOB_SPEC = closed(
    activeDeadlineSeconds=COUNT,
    backoffLimit=COUNT,
    clusterSelector=LABELS,
    entrypoint=TEXT,
    entrypointNumCpus={"type": "number"},
    jobId=TEXT,
    metadata={"type": "object"},
    rayClusterSpec=RAY_CLUSTER_SPEC,
    runtimeEnvYAML=TEXT,
    shutdownAfterJobFinishes=FLAG,
    submissionMode=one_of("K8sJobMode", "HTTPMode", "InteractiveMode", "SidecarMode"),
    submitterConfig=closed(backoffLimit=COUNT),
    submitterPodTemplate=POD_TEMPLATE,
    suspend=FLAG,
    ttlSecondsAfterFinished=COUNT,
)
PEERS = many(closed(podSelector=SELECTOR, namespaceSelector=SELECTOR, ipBlock=closed(("cidr",), cidr=TEXT)))
POLICY_PORTS = many(closed(protocol=one_of("TCP", "UDP", "SCTP"), port=PORT, endPort=PORT))
NETWORK_POLICY_SPEC = closed(
    ("podSelector",),
    podSelector=SELECTOR,
    policyTypes=many(one_of("Ingress", "Egress")),
    ingress=many(closed(**{"from": PEERS, "ports": POLICY_PORTS})),
    egress=many(closed(to=PEERS, ports=POLICY_PORTS)),
)
CLAIM_SPEC = closed(
    ("accessModes", "resources"),
    accessModes=many(one_of("ReadWriteOnce", "ReadOnlyMany", "ReadWriteMany", "ReadWriteOncePod")),
    resources=RESOURCES,
    storageClassName=NAME,
)


def manifest(version: str, kind: str, spec: Schema) -> Schema:
    """A whole object of the API."""
    return closed(
        ("apiVersion", "kind", "metadata", "spec"),
        apiVersion=one_of(version),
        kind=one_of(kind),
        metadata=METADATA,
        spec=spec,
    )


KINDS = {
    "RayCluster": manifest("ray.io/v1", "RayCluster", RAY_CLUSTER_SPEC),
    "RayJob": manifest("ray.io/v1", "RayJob", RAY_JOB_SPEC),
    "NetworkPolicy": manifest("networking.k8s.io/v1", "NetworkPolicy", NETWORK_POLICY_SPEC),
    "PersistentVolumeClaim": manifest("v1", "PersistentVolumeClaim", CLAIM_SPEC),
}
